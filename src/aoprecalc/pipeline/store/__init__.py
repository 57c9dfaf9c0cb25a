"""What is there already: records of an output folder, and the cache that batches share."""
