"""Who does the work: processes that do jobs, and the crew that has them."""
