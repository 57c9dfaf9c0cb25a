"""Pictures of results: previews by OpenGL or rays, shaded by NumPy; false-colour pictures of errors.

Nothing is imported here: of these modules only some need what is slow to import.
"""
