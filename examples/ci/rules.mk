# For a Makefile: `include rules.mk` below its first target, which stays the default.
AOPRECALC ?= aoprecalc
BAKE ?= --size 512 --directions 256

# All that the manifest says. Make cannot see whether there is something to do, batch can: it knows the files that meshes
# refer to, its own options and its version.
.PHONY: assets
assets:
	$(AOPRECALC) batch aoprecalc.toml

# One OBJ by itself, for targets that need it: one bake makes the texture and the mesh with its UVs. Not in build/ao, which
# batch looks after. No half-written file is left behind by a bake that fails, so there is nothing to delete.
build/%_ao.png build/%_ao.obj: assets/%.obj
	$(AOPRECALC) bake $< -o $(@D)/ $(BAKE)
