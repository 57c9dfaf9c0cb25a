"""The same on the machines of a Dask cluster."""
