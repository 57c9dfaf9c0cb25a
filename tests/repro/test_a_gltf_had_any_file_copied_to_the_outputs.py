"""A .gltf that named /etc/passwd as an image had it copied beside the result, for whoever gets the results."""

import json

import pytest

from gltf_kit.gltf_maker import png, textured_triangle


def bake(tmp_path, command, uri):
    """Bake a .gltf in a folder of its own whose material shows the image at a URI; returns its results and stderr."""
    document = textured_triangle(images=[{"uri": uri}])
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "color.png").write_bytes(png([[0]]))
    (tmp_path / "in" / "color.tga").write_bytes(b"of a kind that glTF does not name")
    (tmp_path / "in" / "a.gltf").write_text(json.dumps(document), encoding="utf-8")
    words = ("--size", "32", "-n", "64", "--backend", "ray", "-o", f"{tmp_path}/out/")
    done = command("bake", tmp_path / "in" / "a.gltf", *words)
    assert done.returncode == 0, done.stderr
    return {file.name for file in (tmp_path / "out").iterdir()} - {"a_ao.gltf", "a_ao.bin", "a_ao.png"}, done.stderr


@pytest.mark.parametrize(
    "name", ["{folder}/secret.txt", "../secret.txt", "..%2Fsecret.txt", "file://{folder}/secret.txt"]
)
def test_a_file_elsewhere_that_is_no_image_stays_there(name, tmp_path, command):
    (tmp_path / "secret.txt").write_text("secret", encoding="utf-8")
    copied, said = bake(tmp_path, command, name.format(folder=tmp_path.as_posix()))
    assert copied == set()
    assert name.startswith("..") is ("not copied, as it is not an image" in said)


def test_images_come_along_as_before(tmp_path, command):
    (tmp_path / "shared.png").write_bytes(png([[0]]))
    assert bake(tmp_path, command, "../shared.png")[0] == {"shared.png"}


@pytest.mark.parametrize("name", ["color.png", "color.tga"])
def test_whatever_is_in_the_assets_folder_comes_along(name, tmp_path, command):
    assert bake(tmp_path, command, name)[0] == {name}
