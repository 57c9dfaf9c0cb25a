"""Baked glTF documents beside what they were: valid, baked where they should be, and nothing else is changed."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from aoprecalc.api.bake import FileBake, bake_file
from aoprecalc.io import load_scene
from aoprecalc.io.formats.gltf.occlusion_textures import gltf_occlusion
from aoprecalc.options import BakeOptions
from gltf_kit.gltf_compare import differences
from gltf_kit.gltf_documents import CHECKS, DOCUMENTS
from gltf_kit.gltf_maker import GltfMaker, png
from gltf_kit.gltf_occlusion import occlusion_faults, receivers
from gltf_kit.gltf_validator import WARNING, issues, needs_validator, new_issues
from gltf_kit.gltf_values import GltfValues


@dataclass(frozen=True)
class Case:
    """A document, the kind of file it is in and the kind it is written as, and how it is baked."""

    name: str
    kind: str
    written: str
    options: dict = field(default_factory=dict)

    def __str__(self):
        kinds = self.kind if self.kind == self.written else f"{self.kind}-to-{self.written}"
        return "-".join([self.name, kinds, *(f"{key}={value}" for key, value in self.options.items())])


CASES = [Case(name, kind, kind) for name in DOCUMENTS for kind in ("gltf", "glb")]
CASES += [
    Case("data_uris", "gltf", "glb"),
    Case("a_mask_with_a_picture_beside", "gltf", "glb"),
    Case("much_beside_the_mesh", "glb", "gltf"),
    Case("instances_under_different_nodes", "glb", "glb", {"instances": "share"}),
    Case("instances_under_different_nodes", "glb", "glb", {"only": ("inner",)}),
    Case("uvs_that_hold_a_bake", "gltf", "gltf", {"unwrap": "xatlas"}),
]
CASES += [
    Case(name, "glb", "glb", {"normals": "smooth"})
    for name in ("skin", "morph_targets", "nested_mirrors", "quantized_normals", "gpu_instancing", "faces_without_area")
]


def make(name, kind, folder):
    """The path of a document."""
    maker = GltfMaker(folder)
    DOCUMENTS[name](maker)
    return maker.save(f"{name}.{kind}", binary=None if name == "data_uris" else f"{name}.bin")


@dataclass(frozen=True)
class RoundTrip:
    """A document before and after its bake."""

    case: Case
    path: Path
    result: FileBake


@pytest.fixture(scope="module", params=CASES, ids=str)
def trip(request, tmp_path_factory):
    case, folder = request.param, tmp_path_factory.mktemp("trip")
    path, out = make(case.name, case.kind, folder), folder / "out"
    out.mkdir()
    options = BakeOptions(size=64, directions=32, **case.options)
    return RoundTrip(case, path, bake_file(path, out, mesh_output=out / f"baked.{case.written}", options=options))


@needs_validator
def test_the_documents_are_valid(tmp_path):
    files = [make(name, kind, tmp_path) for name in DOCUMENTS for kind in ("gltf", "glb")]
    for file, found in zip(files, issues(*files), strict=True):
        known = ["DATA_URI_GLB"] if file.name == "data_uris.glb" else []
        assert [issue for issue in found if issue["severity"] <= WARNING and issue["code"] not in known] == []


@needs_validator
def test_a_bake_is_as_valid_as_its_document(trip):
    assert new_issues(trip.path, trip.result.files.mesh) == []


@needs_validator
@pytest.mark.parametrize("written", ["gltf", "glb"])
def test_documents_made_of_other_files_are_valid(cube_obj, written):
    out = cube_obj.parent / "out"
    out.mkdir()
    (cube_obj.parent / "paint.png").write_bytes(png(CHECKS))
    (cube_obj.parent / "none.mtl").write_text("newmtl paint 0\nmap_Kd paint.png\n")
    result = bake_file(cube_obj, out, mesh_output=out / f"baked.{written}", options=BakeOptions(size=64, directions=32))
    found = [(issue["code"], issue["pointer"].split("/")[-1]) for issue in issues(result.files.mesh)[0]]
    # A material without a picture has no need of the UVs that its file had.
    assert set(found) <= {("UNUSED_OBJECT", "TEXCOORD_1")}


def test_all_else_is_as_it_was(trip):
    before, after = GltfValues(trip.path), GltfValues(trip.result.files.mesh)
    assert differences(before, after, new_normals="normals" in trip.case.options) == []


def test_materials_show_the_texture_where_it_was_baked(trip):
    picture, wanted = trip.result.files.texture.read_bytes(), receivers(trip.result.baked)
    assert wanted
    before, after = GltfValues(trip.path), GltfValues(trip.result.files.mesh)
    assert occlusion_faults(before, after, picture, wanted) == []


def test_corners_have_the_places_and_normals_of_the_bake(trip):
    baked, back = trip.result.baked, load_scene(trip.result.files.mesh)
    assert back.corners == pytest.approx(baked.scene.corners, abs=1e-6)
    for old, new in zip(baked.scene.parts, back.parts, strict=True):
        place = old if old.uv_owner is None else baked.scene.parts[old.uv_owner]
        if baked.atlas.mapped[place.faces].any():
            uvs = gltf_occlusion(back.document, new).uvs
            covered = baked.atlas.mapped[place.faces]
            assert uvs[covered] == pytest.approx(baked.atlas.uvs[place.faces][covered], abs=1e-6)
            assert back.normals[new.faces] == pytest.approx(baked.normals[old.faces], abs=1e-5)
