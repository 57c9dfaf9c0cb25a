"""Errors against ray tracing, FLIP, and differences between two results, each reduced to one number.

Nothing is imported here: of these modules only some need what is slow to import.
"""
