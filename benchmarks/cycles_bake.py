"""Ambient occlusion of a mesh baked by Blender's Cycles on the CPU, for the interpreter that has `bpy`.

    python benchmarks/cycles_bake.py MESH.(obj|glb) -o OUT.exr [--size 1024] [--samples 64] [--margin 16]
                                     [--shading smooth|flat|file] [--distance X] [--threads N] [--json]

The mesh is one that `aoprecalc bake` wrote, or any other of triangles with UVs. All its parts are baked onto the first
UV set of a linear 32-bit EXR; occluders count up to the distance X, in the units of the mesh (none given: at any), and
nothing is denoised. The last line printed is JSON; its seconds, on the clock and of the processors, are those of the
bake alone, without reading the mesh or writing the picture.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

try:
    import bpy
except ModuleNotFoundError:
    bpy = None


def main() -> None:
    """Bake one mesh and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path, metavar="MESH.(obj|glb)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.exr")
    parser.add_argument("--size", type=int, default=1024, help="side of the texture, in texels")
    parser.add_argument("--samples", type=int, default=64, help="rays a texel")
    parser.add_argument("--margin", type=int, default=16, help="texels by which charts are extended")
    parser.add_argument("--shading", choices=("smooth", "flat", "file"), default="file", help="which normals")
    parser.add_argument("--distance", type=float, help="farther occluders do not count")
    parser.add_argument("--threads", type=int, default=0, help="0: as many as there are cores")
    parser.add_argument("--json", action="store_true", help="print nothing but the JSON on standard output")
    given = parser.parse_args()
    if bpy is None:
        stop("bpy is not installed in this interpreter; pip install bpy (370 MB, Python 3.11)")
    if given.mesh.suffix.lower() not in (".obj", ".glb", ".gltf") or not given.mesh.is_file():
        stop(f"{given.mesh} is not an .obj or .glb file")
    if given.output.suffix.lower() != ".exr":
        stop(f"{given.output} does not end in .exr")
    output = given.output.resolve()
    output.parent.mkdir(parents=True, exist_ok=True)
    stdout = os.dup(1)
    if given.json:
        os.dup2(2, 1)  # Blender's importers print from C
    thing = load(given.mesh.resolve())
    if not thing.data.uv_layers:
        stop(f"{given.mesh} has no UVs")
    shade(thing, given.shading)
    image = make_target(thing, given.size)
    start, used = time.perf_counter(), time.process_time()
    bake(thing, given)
    seconds = {"seconds": time.perf_counter() - start, "processor_seconds": time.process_time() - used}
    image.filepath_raw, image.file_format = str(output), "OPEN_EXR"
    image.save()
    sys.stdout.flush()
    os.dup2(stdout, 1)
    result = {"tool": f"Blender {bpy.app.version_string} Cycles", **{key: round(seconds[key], 3) for key in seconds}}
    print(json.dumps(result | {"samples": given.samples, "size": given.size, "margin": given.margin}))


def stop(message: str) -> None:
    """Leave with one line."""
    print(message, file=sys.stderr)
    sys.exit(2)


def load(path: Path) -> "bpy.types.Object":
    """The file's meshes as one object, alone in an empty scene, selected and active."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.suffix.lower() == ".obj":
        bpy.ops.wm.obj_import(filepath=str(path), use_split_objects=False)
    else:
        bpy.ops.import_scene.gltf(filepath=str(path), merge_vertices=True)
    things = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    if not things:
        stop(f"{path} holds no mesh")
    bpy.ops.object.select_all(action="DESELECT")
    for thing in things:
        thing.select_set(True)
    bpy.context.view_layer.objects.active = things[0]
    if len(things) > 1:
        bpy.ops.object.join()
    return things[0]


def shade(thing: "bpy.types.Object", shading: str) -> None:
    """Keep the file's normals, or drop them for those of the faces or their means at the vertices."""
    if shading != "file":
        bpy.ops.mesh.customdata_custom_splitnormals_clear()
        made = bpy.ops.object.shade_smooth if shading == "smooth" else bpy.ops.object.shade_flat
        made(keep_sharp_edges=False)  # the importers marked edges where the file's normals part


def make_target(thing: "bpy.types.Object", size: int) -> "bpy.types.Image":
    """An image, active in the only material, that the first UV set addresses."""
    image = bpy.data.images.new("ao", size, size, alpha=False, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    material = bpy.data.materials.new("ao")
    nodes = material.node_tree.nodes
    nodes.clear()  # without a surface shader Cycles measures the same and does not follow bounces of light
    nodes.active = nodes.new("ShaderNodeTexImage")
    nodes.active.image = image
    thing.data.materials.clear()
    thing.data.materials.append(material)
    thing.data.uv_layers[0].active = thing.data.uv_layers[0].active_render = True
    return image


def bake(thing: "bpy.types.Object", given: argparse.Namespace) -> None:
    """Bake into the material's image."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    if given.threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", given.threads
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", given.samples
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    scene.world = scene.world or bpy.data.worlds.new("world")
    scene.world.light_settings.ao_factor = 1.0
    everywhere = 10 * thing.dimensions.length
    scene.world.light_settings.distance = everywhere if given.distance is None else given.distance
    bpy.ops.object.bake(type="AO", margin=given.margin, margin_type="ADJACENT_FACES", use_clear=True)


if __name__ == "__main__":
    main()
