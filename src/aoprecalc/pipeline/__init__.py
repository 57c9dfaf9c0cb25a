"""Many assets: each made once, only when it must be, in processes here or on a cluster."""

from aoprecalc.pipeline.cache import Cache, default_cache
from aoprecalc.pipeline.option_tables import make_job_spec
from aoprecalc.pipeline.plan import Plan, plan_batch
from aoprecalc.pipeline.report import AssetResult, BatchProgress
from aoprecalc.pipeline.run import BatchResult, batch, run_batch

__all__ = [
    "AssetResult",
    "BatchProgress",
    "BatchResult",
    "Cache",
    "Plan",
    "batch",
    "default_cache",
    "make_job_spec",
    "plan_batch",
    "run_batch",
]
