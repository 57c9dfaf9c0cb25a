"""Batches of meshes: each asset is made once, only when needed, by worker processes here or on a Dask cluster."""

from aoprecalc.pipeline.option_tables import make_job_spec
from aoprecalc.pipeline.report import AssetResult, BatchProgress, BatchReport
from aoprecalc.pipeline.run import BatchResult, Plan, batch, plan_batch, run_batch
from aoprecalc.pipeline.store import Cache, default_cache

__all__ = [
    "AssetResult",
    "BatchProgress",
    "BatchReport",
    "BatchResult",
    "Cache",
    "Plan",
    "batch",
    "default_cache",
    "make_job_spec",
    "plan_batch",
    "run_batch",
]
