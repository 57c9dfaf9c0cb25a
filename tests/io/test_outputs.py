import numpy as np
import pytest

from aoprecalc.errors import OutputError
from aoprecalc.io import Outputs, load_scene, write_image
from written_meshes import write_with_one_texture

GREY = np.full((4, 4), 0.5, dtype=np.float32)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".gltf", ".glb"])
def test_a_failure_in_the_middle_leaves_nothing(cube_obj, atlas_of, normals_of, tmp_path, suffix):
    scene = load_scene(cube_obj)
    old = tmp_path / f"cube_ao{suffix}"
    old.write_text("an earlier result")
    before = sorted(tmp_path.iterdir())

    def fail():
        with Outputs() as outputs:
            folder = outputs.folder(tmp_path / "new" / "deeper")
            write_image(outputs.path(tmp_path / "x.png"), GREY)
            write_image(outputs.path(folder / "y.png"), GREY)
            write_with_one_texture(outputs, old, scene, atlas_of(scene), normals_of(scene), tmp_path / "x.png")
            raise RuntimeError("in the middle")

    with pytest.raises(RuntimeError):
        fail()
    assert sorted(tmp_path.iterdir()) == before
    assert old.read_text() == "an earlier result"


def test_all_files_appear_together(tmp_path):
    with Outputs() as outputs:
        folder = outputs.folder(tmp_path / "new" / "deeper")
        write_image(outputs.path(folder / "a.png"), GREY)
        assert outputs.written(folder / "a.png").is_file()
        assert not (folder / "a.png").exists()
        (tmp_path / "b").write_text("old")
        outputs.path(tmp_path / "b").write_text("new")
        assert (tmp_path / "b").read_text() == "old"
    assert [file.name for file in folder.iterdir()] == ["a.png"]
    assert (tmp_path / "b").read_text() == "new"
    assert outputs.written(tmp_path / "c") == tmp_path / "c"


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with Outputs() as outputs, pytest.raises(OutputError, match="cannot be made"):
        outputs.folder(tmp_path / "file" / "below")


def test_a_missing_folder_is_told(cube_obj, atlas_of, normals_of, tmp_path):
    scene = load_scene(cube_obj)
    with Outputs() as outputs, pytest.raises(OutputError, match="there is no folder"):
        write_with_one_texture(
            outputs, tmp_path / "no" / "a.obj", scene, atlas_of(scene), normals_of(scene), tmp_path / "x.png"
        )


def test_a_missing_texture_is_told(cube_obj, atlas_of, normals_of, tmp_path):
    scene = load_scene(cube_obj)
    with Outputs() as outputs, pytest.raises(OutputError, match="cannot be written"):
        write_with_one_texture(
            outputs, tmp_path / "a.glb", scene, atlas_of(scene), normals_of(scene), tmp_path / "no.png"
        )
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cube.obj"]
