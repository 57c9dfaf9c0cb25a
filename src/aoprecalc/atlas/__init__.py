"""Where each face lies in the texture: the file's own UVs if they can hold a bake, else a new unwrap."""
