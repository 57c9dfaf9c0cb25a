"""glTF and GLB: documents read, edited and written, with nothing lost that was not asked for."""
