"""UV atlases: check the file's UVs, unwrap, pack, gutters."""
