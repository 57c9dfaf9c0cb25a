"""Real files that break loaders: each gives a scene or one clear line, never anything else."""

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io import load_scene
from shapes import MESHES

KINDS = {".obj", ".ply", ".stl", ".off", ".gltf", ".glb"}
FILES = sorted(file.relative_to(MESHES).as_posix() for file in MESHES.rglob("*") if file.suffix.lower() in KINDS)

# What is known about some of them: (positions, faces), or words of the error.
KNOWN = {
    "bigguy.obj": (1452, 2900),
    "monsterfrog.obj": (1308, 2584),
    "spot.obj": (2930, 5856),
    "stanford-bunny.obj": (34834, 69451),
    "jerry_ogre/bs_rest.obj": (19985, 39856),
    "ToyCar/ToyCar.gltf": (56394, 108936),
    "DamagedHelmet/DamagedHelmet.gltf": (None, 15452),
    "fruitfly_assembled_welded.ply": (137667, 272550),
    "nasty/2CylinderEngine.glb": (None, 121496),
    "nasty/BoxWithInfinites.glb": "not finite",
    "nasty/IndexOutOfRange/AllIndicesOutOfRange.gltf": "refers to vertex 65535, but there are 24",
    "nasty/IndexOutOfRange/IndexOutOfRange.gltf": "refers to vertex 255, but there are 24",
    "nasty/OutOfMemory.off": "promises 353535235358 vertices",
    "nasty/cube-shuffled.off": (8, 12),
    "nasty/draco/2CylinderEngine.gltf": (None, 110336),
    "nasty/empty.ply": "no faces",
    "nasty/empty.stl": "no faces",
    "nasty/empty_0bytes.obj": "is empty",
    "nasty/igea.ply": (134345, 268686),
    "nasty/large_block_obb.STL": (8, 12),
    "nasty/lfs_pointer.obj": "git lfs pull",
    "nasty/malformed.obj": "refers to v 12, but there are 8",
    "nasty/negative_indices.obj": (8, 12),
    "nasty/soup.stl": (None, 100),
    "nasty/zero_area_face.obj": "none of 1 face has any area",
}


@pytest.mark.corpus
@pytest.mark.parametrize("name", FILES or ["none"])
def test_it_loads_or_says_why_not(name, capfd, recwarn):
    known = KNOWN.get(name)
    if isinstance(known, str):
        with pytest.raises(InputError) as failure:
            load_scene(MESHES / name)
        assert known in str(failure.value)
        assert "\n" not in str(failure.value)
    else:
        scene = load_scene(MESHES / name)
        check(scene)
        positions, faces = known or (None, None)
        assert positions in (None, len(scene.positions))
        assert faces in (None, len(scene.faces))
    assert capfd.readouterr() == ("", "")
    assert not recwarn.list


def check(scene):
    """Hold a scene to what its docstring promises."""
    assert np.isfinite(scene.positions).all()
    assert np.array_equal(np.unique(scene.faces), np.arange(len(scene.positions)))
    assert len(np.unique(scene.positions, axis=0)) == len(scene.positions)
    if scene.normals is not None:
        assert np.linalg.norm(scene.normals, axis=2) == pytest.approx(1, abs=1e-5)
    if scene.uvs is not None:
        assert np.isfinite(scene.uvs).all()
    assert [part.start for part in scene.parts] == [0, *(part.stop for part in scene.parts[:-1])]
    assert scene.parts[-1].stop == len(scene.faces)
    assert all(part.vertices.shape == (part.stop - part.start, 3) for part in scene.parts)
    assert all("\n" not in line for line in scene.warnings)
