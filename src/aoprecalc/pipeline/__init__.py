"""Many assets: each made once, only when it must be, in processes here or on a cluster."""

from aoprecalc.pipeline.batch import BatchResult, batch, run
from aoprecalc.pipeline.planning.orders import read_order
from aoprecalc.pipeline.planning.plan import Plan, plan
from aoprecalc.pipeline.store.cache import Cache, default_cache
from aoprecalc.pipeline.watching import Result, Watcher

__all__ = ["BatchResult", "Cache", "Plan", "Result", "Watcher", "batch", "default_cache", "plan", "read_order", "run"]
