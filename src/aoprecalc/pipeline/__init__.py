"""Many assets: each made once, only when it must be, in processes here or on a cluster."""

from aoprecalc.pipeline.cache import Cache, default_cache
from aoprecalc.pipeline.option_tables import read_order
from aoprecalc.pipeline.plan import Plan, plan
from aoprecalc.pipeline.report import Result, Watcher
from aoprecalc.pipeline.run import BatchResult, batch, run

__all__ = ["BatchResult", "Cache", "Plan", "Result", "Watcher", "batch", "default_cache", "plan", "read_order", "run"]
