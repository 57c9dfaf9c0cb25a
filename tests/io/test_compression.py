"""Compressed glTF decoded: against the plain data, and the filters against slow ones written from the specification."""

import math
import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io.formats.gltf import compression
from aoprecalc.io.formats.gltf.compression import decompress
from aoprecalc.io.formats.gltf.document import GltfDocument, float_values, raw_values, view_bytes

DRACO, EXT, KHR = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"

RANDOM = np.random.default_rng(5)
GRID = 12
POINTS = np.stack(np.meshgrid(np.arange(GRID), np.arange(GRID), indexing="ij"), axis=-1).reshape(-1, 2)
POINTS = np.column_stack([POINTS, np.sin(POINTS[:, 0])]).astype("<f4")
CORNERS = (np.arange(GRID - 1)[:, None] * GRID + np.arange(GRID - 1)).reshape(-1, 1)
TRIANGLES = np.concatenate([CORNERS + [0, GRID, 1], CORNERS + [1, GRID, GRID + 1]]).astype("<u4")
COUNT = len(POINTS)


@pytest.fixture
def dracopy():
    return pytest.importorskip("DracoPy")


@pytest.fixture
def meshoptimizer():
    return pytest.importorskip("meshoptimizer")


def close(gltf, *stand_ins):
    """Return what was made as a document, with more buffers of given sizes that hold nothing."""
    gltf.json["buffers"] = [{"byteLength": size} for size in (len(gltf.data), *stand_ins)]
    return GltfDocument(Path("made.glb"), gltf.json, (bytes(gltf.data), *(b"" for _ in stand_ins)))


def promise(gltf, array, **members):
    """Describe an array in an accessor that has no data."""
    index = gltf.accessor(array, bufferView=None, **members)
    del gltf.json["accessors"][index]["bufferView"]
    return index


def require(gltf, *names):
    gltf.json |= {"extensionsUsed": list(names), "extensionsRequired": list(names)}


def add_draco(gltf, stream, ids, attributes, indices=None, **members):
    """Add a mesh of one compressed primitive; `stream` is its bytes or a buffer view."""
    view = gltf.view(stream) if isinstance(stream, bytes) else stream
    primitive = {"attributes": attributes, "extensions": {DRACO: {"bufferView": view, "attributes": ids}}, **members}
    gltf.mesh(primitive if indices is None else primitive | {"indices": indices})
    return view


def triangle_draco(gltf, dracopy, **members):
    """Make the grid, positions and indices only, and lossless; return the bytes of its stream."""
    stream = dracopy.encode(POINTS, TRIANGLES, quantization_bits=0, preserve_order=True)
    attributes = {"POSITION": promise(gltf, POINTS)}
    add_draco(gltf, stream, {"POSITION": 0}, attributes, promise(gltf, TRIANGLES.reshape(-1)), **members)
    require(gltf, DRACO)
    return stream


def primitive_of(document, mesh=0):
    return document.json["meshes"][mesh]["primitives"][0]


def refused(document, said):
    with pytest.raises(InputError) as failure:
        decompress(document)
    message = str(failure.value)
    assert message.startswith("made.glb: ")
    assert said in message
    assert "\n" not in message


def least_first(triangles):
    """The same triangles, each turned so that it begins with its least vertex, as coders may turn them."""
    return [tuple(np.roll(row, -row.argmin()).tolist()) for row in triangles]


def test_a_plain_document_is_returned_as_it_is(gltf_cube):
    gltf, primitive = gltf_cube
    gltf.mesh(primitive)
    document = close(gltf)
    assert decompress(document) is document


def test_names_that_are_only_listed_are_dropped(gltf_cube):
    gltf, primitive = gltf_cube
    gltf.mesh(primitive)
    gltf.json |= {"extensionsUsed": ["KHR_texture_transform", EXT, DRACO], "extensionsRequired": [EXT]}
    document = close(gltf)
    plain = decompress(document)
    assert plain.json["extensionsUsed"] == ["KHR_texture_transform"]
    assert "extensionsRequired" not in plain.json
    assert plain.buffers == document.buffers
    assert document.json["extensionsRequired"] == [EXT]


# Draco


def test_draco_gives_back_every_kind_of_attribute(gltf, dracopy):
    values = {
        "POSITION": POINTS,
        "TEXCOORD_0": RANDOM.random((COUNT, 2)).astype("<f4"),
        "NORMAL": RANDOM.random((COUNT, 3)).astype("<f4"),
        "COLOR_0": RANDOM.integers(0, 256, (COUNT, 3)).astype("u1"),
        "JOINTS_0": RANDOM.integers(0, 256, (COUNT, 4)).astype("u1"),
        "JOINTS_1": RANDOM.integers(0, 65536, (COUNT, 4)).astype("<u2"),
        "WEIGHTS_0": RANDOM.random((COUNT, 4)).astype("<f4"),
        "_NUMBER": np.arange(COUNT, dtype="<u4") * 10**7,
        "JOINTS_2": RANDOM.integers(0, 256, (COUNT, 4)).astype("<u2"),
    }
    generic = {"JOINTS_0": 7, "JOINTS_1": 9, "WEIGHTS_0": 3, "_NUMBER": 4, "JOINTS_2": 5}
    stream = dracopy.encode(
        values["POSITION"],
        TRIANGLES,
        quantization_bits=0,
        preserve_order=True,
        colors=values["COLOR_0"],
        tex_coord=values["TEXCOORD_0"].astype(float),
        normals=values["NORMAL"].astype(float),
        # JOINTS_2 has 8 bits in the stream and 16 in the accessor
        generic_attributes={
            number: values[name].astype("u1" if name == "JOINTS_2" else values[name].dtype).reshape(COUNT, -1)
            for name, number in generic.items()
        },
    )
    ids = generic | {"COLOR_0": 10, "TEXCOORD_0": 11, "NORMAL": 12, "POSITION": 13}
    extra = gltf.accessor(np.arange(COUNT, dtype="<f4"))
    attributes = {name: promise(gltf, array) for name, array in values.items()} | {"_EXTRA": extra}
    gltf.json["accessors"][attributes["COLOR_0"]]["normalized"] = True
    view = add_draco(gltf, stream, ids, attributes, promise(gltf, TRIANGLES.reshape(-1).astype("<u2")), material=3)
    require(gltf, DRACO)
    document = close(gltf)
    before = deepcopy(document.json)
    plain = decompress(document)

    assert document.json == before
    primitive = primitive_of(plain)
    assert primitive == {"attributes": attributes, "indices": len(attributes), "material": 3}
    for name, array in values.items():
        found = raw_values(plain, attributes[name])
        assert found.dtype == array.dtype
        assert np.array_equal(found, array.reshape(COUNT, -1)), name
    assert np.array_equal(raw_values(plain, primitive["indices"]).reshape(-1, 3), TRIANGLES)
    assert plain.json["accessors"][extra] == before["accessors"][extra]
    for key in ("componentType", "count", "type", "normalized"):
        kept = [entry.get(key) for entry in plain.json["accessors"]]
        assert kept == [entry.get(key) for entry in before["accessors"]]
    assert not {"extensionsUsed", "extensionsRequired"} & plain.json.keys()

    # One more buffer, whose first view has taken the place of the compressed bytes.
    assert [buffer["byteLength"] for buffer in plain.json["buffers"]] == [len(data) for data in plain.buffers]
    assert plain.buffers[:-1] == document.buffers
    views = plain.json["bufferViews"]
    assert views[view]["buffer"] == 1
    assert len(views) == len(before["bufferViews"]) + len(values)
    color = views[plain.json["accessors"][attributes["COLOR_0"]]["bufferView"]]
    assert (color["byteStride"], color["target"]) == (4, 34962)
    assert all(view["byteOffset"] % 4 == 0 for view in views)


def test_draco_with_quantised_numbers_and_an_order_of_its_own(gltf, dracopy):
    bits = 12
    stream = dracopy.encode(POINTS, TRIANGLES, quantization_bits=bits, compression_level=7)
    bounds = {"min": POINTS.min(axis=0).tolist(), "max": POINTS.max(axis=0).tolist()}
    attributes = {"POSITION": promise(gltf, POINTS, **bounds)}
    add_draco(gltf, stream, {"POSITION": 0}, attributes, promise(gltf, TRIANGLES.reshape(-1)))
    plain = decompress(close(gltf))
    points = raw_values(plain, attributes["POSITION"])
    distances = np.linalg.norm(points[:, None] - POINTS, axis=2)
    assert distances.min(axis=1).max() <= GRID / 2**bits
    triangles = distances.argmin(axis=1)[raw_values(plain, primitive_of(plain)["indices"]).reshape(-1, 3)]
    assert sorted(least_first(triangles)) == sorted(least_first(TRIANGLES))
    # The bounds are those of the decoded numbers.
    accessor = plain.json["accessors"][attributes["POSITION"]]
    assert accessor["min"] == points.min(axis=0).tolist()
    assert accessor["max"] == points.max(axis=0).tolist()


def test_draco_signed_integers(gltf, dracopy):
    points = RANDOM.integers(-500, 500, (COUNT, 3)).astype("<i2")
    stream = dracopy.encode(points.astype("i4"), TRIANGLES, preserve_order=True)
    attributes = {"POSITION": promise(gltf, points)}
    add_draco(gltf, stream, {"POSITION": 0}, attributes)
    assert np.array_equal(raw_values(decompress(close(gltf)), attributes["POSITION"]), points)


def test_draco_signed_fractions(gltf, dracopy):
    points = RANDOM.integers(-32767, 32768, (COUNT, 3)).astype("<i2")
    stream = dracopy.encode(points.astype("i4"), TRIANGLES, preserve_order=True)
    # The encoder does not offer them: a position of three int32, not normalized, becomes one of int16, normalized.
    assert stream.count(bytes([0, 5, 3, 0])) == 1
    stream = stream.replace(bytes([0, 5, 3, 0]), bytes([0, 3, 3, 1]))
    attributes = {"POSITION": promise(gltf, points, normalized=True)}
    add_draco(gltf, stream, {"POSITION": 0}, attributes)
    plain = decompress(close(gltf))
    assert np.array_equal(raw_values(plain, attributes["POSITION"]), points)
    assert np.allclose(float_values(plain, attributes["POSITION"]), points / 32767)


def test_draco_streams_and_accessors_that_are_shared(gltf, dracopy, monkeypatch):
    read = []
    original = compression.read_stream
    monkeypatch.setattr(compression, "read_stream", lambda *given: read.append(given[1]) or original(*given))
    streams = [dracopy.encode(POINTS + add, TRIANGLES, quantization_bits=0, preserve_order=True) for add in (0, 5)]
    position, indices = promise(gltf, POINTS), promise(gltf, TRIANGLES.reshape(-1))
    first = add_draco(gltf, streams[0], {"POSITION": 0}, {"POSITION": position}, indices)
    add_draco(gltf, first, {"POSITION": 0}, {"POSITION": position}, indices)
    second = add_draco(gltf, streams[1], {"POSITION": 0}, {"POSITION": position}, indices)
    plain = decompress(close(gltf))

    assert read == [first, second]
    primitives = [primitive_of(plain, mesh) for mesh in range(3)]
    assert primitives[0] == primitives[1] == {"attributes": {"POSITION": position}, "indices": indices}
    assert primitives[2]["attributes"]["POSITION"] not in (position, indices)
    assert np.array_equal(raw_values(plain, position), POINTS)
    assert np.array_equal(raw_values(plain, primitives[2]["attributes"]["POSITION"]), POINTS + 5)
    assert len(plain.json["bufferViews"]) == 4


@pytest.mark.parametrize("mode", [None, 4, 5])
def test_draco_triangles_that_no_accessor_describes(gltf, dracopy, mode):
    stream = dracopy.encode(POINTS, TRIANGLES, quantization_bits=0, preserve_order=True)
    strip = {} if mode is None else {"mode": mode}
    indices = promise(gltf, np.arange(7, dtype="<u2")) if mode == 5 else None
    add_draco(gltf, stream, {"POSITION": 0}, {"POSITION": promise(gltf, POINTS)}, indices, **strip)
    plain = decompress(close(gltf))
    primitive = primitive_of(plain)
    assert primitive.get("mode", 4) == 4
    assert np.array_equal(raw_values(plain, primitive["indices"]).reshape(-1, 3), TRIANGLES)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda accessors: accessors[0].update(count=9), "accessor 0 describes 9 elements of 3 numbers"),
        (lambda accessors: accessors[0].update(type="VEC2"), "describes 144 elements of 2 numbers"),
        (lambda accessors: accessors[0].update(componentType=5123), "accessor 0 describes numbers of type uint16"),
        (lambda accessors: accessors[1].update(componentType=5126), "accessor 1 describes numbers of type float32"),
        (lambda accessors: accessors[1].update(componentType=5120), "accessor 1 describes numbers of type int8"),
    ],
)
def test_draco_that_is_not_what_its_accessors_describe(gltf, dracopy, change, said):
    triangle_draco(gltf, dracopy)
    change(gltf.json["accessors"])
    refused(close(gltf), said)


def test_a_draco_attribute_that_is_not_there(gltf, dracopy):
    stream = dracopy.encode(POINTS, TRIANGLES)
    add_draco(gltf, stream, {"POSITION": 4}, {"POSITION": promise(gltf, POINTS)})
    refused(close(gltf), "attribute 4 was expected")


@pytest.mark.parametrize("preserve_order", [False, True])
def test_damaged_draco_streams(gltf, dracopy, preserve_order):
    stream = dracopy.encode(POINTS, TRIANGLES, preserve_order=preserve_order)
    cloud = dracopy.encode(POINTS)
    many = cloud[:11] + b"\xff\xff\xff\x7f" + cloud[15:]  # which would take all memory that there is
    damaged = [stream[:length] for length in (0, 4, 7, 8, 11, 40, len(stream) // 2, len(stream) - 9)]
    damaged += [b"x" * 100, stream[:11] + RANDOM.bytes(len(stream) - 11), cloud, many, stream[:12] + b"\xff" * 99]
    view = add_draco(gltf, stream, {"POSITION": 0}, {"POSITION": promise(gltf, POINTS)})
    document = close(gltf)
    for data in damaged:
        document.json["bufferViews"][view] = {"buffer": 0, "byteLength": len(data)}
        refused(GltfDocument(document.path, document.json, (data,)), f"buffer view {view}")


def test_mutated_draco_streams_do_no_harm(gltf, dracopy):
    stream = triangle_draco(gltf, dracopy)
    document = close(gltf)
    at = document.buffers[0].index(b"DRACO")
    for seed in range(300):
        random = np.random.default_rng(seed)
        data = bytearray(document.buffers[0])
        for _ in range(random.integers(1, 4)):
            data[at + random.integers(len(stream))] = random.integers(256)
        said = complaint(GltfDocument(document.path, document.json, (bytes(data),)))
        assert said is None or "damaged" in said, f"seed {seed}"


def complaint(document):
    """What is said of a document that cannot be decompressed; None of one that can."""
    try:
        decompress(document)
    except InputError as error:
        return str(error)
    return None


def draco_beside_plain(gltf):
    """Make a primitive with plain data beside what is no Draco stream."""
    attributes = {"POSITION": gltf.accessor(POINTS), "_NEW": promise(gltf, POINTS)}
    add_draco(gltf, b"none", {"POSITION": 0}, attributes, gltf.accessor(TRIANGLES.reshape(-1)))


def test_plain_data_beside_draco_are_kept(gltf):
    draco_beside_plain(gltf)
    gltf.json["extensionsUsed"] = [DRACO]
    document = close(gltf)
    plain = decompress(document)
    assert primitive_of(plain) == {key: value for key, value in primitive_of(document).items() if key != "extensions"}
    assert plain.json["accessors"] == document.json["accessors"]
    assert plain.buffers == document.buffers


def test_plain_data_beside_draco_that_is_required(gltf, dracopy, monkeypatch):
    draco_beside_plain(gltf)
    require(gltf, DRACO)
    document = close(gltf)
    refused(document, "a Draco mesh was expected")
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    assert decompress(document).json["accessors"] == document.json["accessors"]


@pytest.mark.parametrize("missing", ["bufferView", "bytes", "indices"])
def test_draco_without_its_library(gltf, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    draco_beside_plain(gltf)
    if missing == "bytes":
        gltf.json["bufferViews"][0]["buffer"] = 1
    else:
        del gltf.json["accessors"][0 if missing == "bufferView" else 2]["bufferView"]
    refused(close(gltf, 9999), f"compressed by {DRACO}, which needs the package DracoPy; `pip install 'aoprecalc[")


# meshoptimizer


def add_meshopt(gltf, stream, count, stride, mode, extension=EXT, buffer=1, **members):
    """Add a buffer view that stands for compressed bytes; the plain ones would be in buffer 1."""
    gltf.data += bytes(-len(gltf.data) % 4)
    packed = {"buffer": 0, "byteOffset": len(gltf.data), "byteLength": len(stream)}
    packed |= {"count": count, "byteStride": stride, "mode": mode}
    packed |= {"filter": members.pop("filter")} if "filter" in members else {}
    gltf.data += stream
    entry = {"buffer": buffer, "byteLength": count * stride, "extensions": {extension: packed}, **members}
    gltf.json["bufferViews"].append(entry)
    return len(gltf.json["bufferViews"]) - 1


def encode_rows(meshoptimizer, rows, version=0):
    meshoptimizer.encode_vertex_version(version)
    return meshoptimizer.encode_vertex_buffer(np.ascontiguousarray(rows).view("u1").reshape(len(rows), -1))


def decoded_view(gltf, view):
    return view_bytes(decompress(close(gltf, 10**6)), view)


@pytest.mark.parametrize("stride", [4, 8, 12, 20, 64, 256])
@pytest.mark.parametrize(("extension", "version"), [(EXT, 0), (KHR, 0), (KHR, 1)])
def test_meshopt_attributes(gltf, meshoptimizer, stride, extension, version):
    rows = np.cumsum(RANDOM.integers(0, 4, (777, stride)), axis=0).astype("u1")
    rows[:, ::5] = RANDOM.integers(0, 256, rows[:, ::5].shape)
    view = add_meshopt(gltf, encode_rows(meshoptimizer, rows, version), 777, stride, "ATTRIBUTES", extension)
    assert decoded_view(gltf, view) == rows.tobytes()


@pytest.mark.parametrize("kind", ["<u2", "<u4"])
def test_meshopt_indices(gltf, meshoptimizer, kind):
    indices = RANDOM.integers(0, 65536, 1001).astype(kind)
    stream = meshoptimizer.encode_index_sequence(indices)
    view = add_meshopt(gltf, stream, 1001, indices.itemsize, "INDICES", filter="NONE")
    assert decoded_view(gltf, view) == indices.tobytes()


@pytest.mark.parametrize("kind", ["<u2", "<u4"])
def test_meshopt_triangles(gltf, meshoptimizer, kind):
    stream = meshoptimizer.encode_index_buffer(TRIANGLES.reshape(-1))
    view = add_meshopt(gltf, stream, TRIANGLES.size, np.dtype(kind).itemsize, "TRIANGLES")
    triangles = np.frombuffer(decoded_view(gltf, view), kind).reshape(-1, 3)
    assert least_first(triangles) == least_first(TRIANGLES)


def round_away(value):
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def slow_octahedral(row):
    x, y, one, rest = (int(value) for value in row)
    x, y = x / one, y / one
    z = 1 - abs(x) - abs(y)
    fold = min(z, 0)
    x, y = x - math.copysign(fold, x), y - math.copysign(fold, y)
    length = math.sqrt(x * x + y * y + z * z)
    return [*(round_away(value / length * np.iinfo(row.dtype).max) for value in (x, y, z)), rest]


def slow_quaternion(row):
    *three, last = (int(value) for value in row)
    x, y, z = (value / (last | 3) / math.sqrt(2) for value in three)
    w = math.sqrt(max(0, 1 - x * x - y * y - z * z))
    result = [0] * 4
    for step, value in enumerate((w, x, y, z)):
        result[(last + step) % 4] = round_away(value * 32767)
    return result


def slow_exponential(row):
    exponents, mantissas = [int(value) >> 24 for value in row], [int(value) & 0xFFFFFF for value in row]
    signed = [value - (1 << 24) if value >= 1 << 23 else value for value in mantissas]
    return [math.ldexp(mantissa, exponent) for mantissa, exponent in zip(signed, exponents, strict=True)]


def slow_color(row):
    luma, orange, green, marked = (int(value) for value in row)
    bits = marked.bit_length()
    full, greatest = np.iinfo(row.dtype).max, (1 << bits) - 1
    orange, green = (value - full - 1 if value > full // 2 else value for value in (orange, green))
    alpha = marked - (1 << (bits - 1))
    colors = (luma + orange - green, luma + green, luma - orange - green, 2 * alpha + alpha % 2)
    return [round_away(value * full / greatest) for value in colors]


def octahedral_rows(kind):
    ones = (1 << RANDOM.integers(1, np.iinfo(kind).bits, 500)) - 1
    return np.column_stack([RANDOM.integers(-ones, ones + 1), RANDOM.integers(-ones, ones + 1), ones, ones - 7])


def quaternion_rows():
    ones = (1 << RANDOM.integers(3, 16, 500)) - 1
    three = [RANDOM.integers(-ones, ones + 1) for _ in range(3)]
    return np.column_stack([*three, ones & ~3 | RANDOM.integers(0, 4, 500)])


def exponential_rows():
    return RANDOM.integers(-100, 101, (500, 3)) * (1 << 24) + RANDOM.integers(0, 1 << 24, (500, 3))


def color_rows(kind):
    bits = RANDOM.integers(2, np.iinfo(kind).bits + 1, 500)
    limits = (1 << bits) - 1
    red, green, blue = (RANDOM.integers(0, limits + 1) for _ in range(3))
    middle = (red + blue) // 2  # the filter rounds; what it cannot store exactly is left out
    parts = np.column_stack([(middle + green) // 2, (red - blue) // 2, (green - middle) // 2])
    luma, orange, chroma = parts.T
    back = np.column_stack([luma + orange - chroma, luma + chroma, luma - orange - chroma])
    inside = ((back >= 0) & (back <= limits[:, None])).all(axis=1)
    alpha = RANDOM.integers(0, limits // 2 + 1)
    return (np.column_stack([parts, limits // 2 + 1 + alpha]) % (np.iinfo(kind).max + 1))[inside]


@pytest.mark.parametrize(
    ("name", "rows", "slow", "kinds", "error"),
    [
        ("OCTAHEDRAL", octahedral_rows("i1"), slow_octahedral, ("i1", "i1"), 1),
        ("OCTAHEDRAL", octahedral_rows("<i2"), slow_octahedral, ("<i2", "<i2"), 1),
        ("QUATERNION", quaternion_rows(), slow_quaternion, ("<i2", "<i2"), 1),
        ("EXPONENTIAL", exponential_rows(), slow_exponential, ("<i4", "<f4"), 0),
        ("COLOR", color_rows("u1"), slow_color, ("u1", "u1"), 1),
        ("COLOR", color_rows("<u2"), slow_color, ("<u2", "<u2"), 1),
    ],
)
def test_meshopt_filters(gltf, meshoptimizer, name, rows, slow, kinds, error):
    stored = rows.astype(kinds[0])
    stride = stored.itemsize * stored.shape[1]
    stream = encode_rows(meshoptimizer, stored)
    view = add_meshopt(gltf, stream, len(rows), stride, "ATTRIBUTES", KHR, filter=name)
    plain = np.frombuffer(decoded_view(gltf, view), kinds[1]).reshape(rows.shape)
    expected = np.array([slow(row) for row in stored], dtype=np.float64)
    assert len(rows) > 100
    assert np.abs(plain - expected).max() <= error
    if name == "OCTAHEDRAL":
        assert np.array_equal(plain[:, 3], stored[:, 3])


def test_meshopt_views_stay_what_they_were(gltf, meshoptimizer):
    rows = RANDOM.integers(-(1 << 23), 1 << 23, (COUNT, 3)).astype("<i4") & 0xFFFFFF  # exponents of 0
    members = {"byteStride": 12, "target": 34962, "name": "points", "filter": "EXPONENTIAL"}
    view = add_meshopt(gltf, encode_rows(meshoptimizer, rows), COUNT, 12, "ATTRIBUTES", **members)
    other = gltf.view(b"plain")
    index = gltf.accessor(POINTS, bufferView=view, min=[0, 0, 0], max=[1, 1, 1])
    require(gltf, "KHR_mesh_quantization", EXT)
    document = close(gltf, COUNT * 12)
    document.json["buffers"][1]["extensions"] = {EXT: {"fallback": True}}
    before = deepcopy(document.json)
    plain = decompress(document)

    assert document.json == before
    assert plain.json["bufferViews"][view] == {
        "buffer": 2,
        "byteOffset": 0,
        "byteLength": COUNT * 12,
        "byteStride": 12,
        "target": 34962,
        "name": "points",
    }
    assert plain.json["bufferViews"][other] == before["bufferViews"][other]
    assert plain.json["buffers"] == [*before["buffers"], {"byteLength": COUNT * 12}]
    assert plain.buffers[:2] == document.buffers
    assert plain.json["extensionsUsed"] == plain.json["extensionsRequired"] == ["KHR_mesh_quantization"]
    values = raw_values(plain, index)
    assert np.array_equal(values, [slow_exponential(row) for row in rows])
    accessor = plain.json["accessors"][index]
    assert (accessor["min"], accessor["max"]) == (values.min(axis=0).tolist(), values.max(axis=0).tolist())


def test_meshopt_beside_draco(gltf, dracopy, meshoptimizer):
    extra = np.arange(COUNT, dtype="<f4")
    view = add_meshopt(gltf, encode_rows(meshoptimizer, extra[:, None]), COUNT, 4, "ATTRIBUTES", KHR)
    triangle_draco(gltf, dracopy)
    attributes = primitive_of(close(gltf))["attributes"]
    attributes["_EXTRA"] = gltf.accessor(extra, bufferView=view)
    require(gltf, DRACO, KHR)
    plain = decompress(close(gltf, COUNT * 4))
    assert np.array_equal(raw_values(plain, attributes["POSITION"]), POINTS)
    assert np.array_equal(raw_values(plain, attributes["_EXTRA"])[:, 0], extra)
    assert not {"extensionsUsed", "extensionsRequired"} & plain.json.keys()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mode": "POINTS"}, "compressed by 'POINTS' with 'NONE', which do not exist"),
        ({"filter": "SEPIA"}, "with 'SEPIA', which do not exist"),
        ({"count": 12}, "has 96 bytes, not possible with 12 x 4"),
        ({"count": -24}, "not possible with -24 x 4"),
        ({"byteStride": 3, "count": 32}, "not possible with 32 x 3"),
        ({"byteStride": 6, "count": 16}, "not possible with 16 x 6"),
        ({"filter": "QUATERNION"}, "ATTRIBUTES and QUATERNION"),
        ({"filter": "OCTAHEDRAL", "byteStride": 16, "count": 6}, "16 bytes of ATTRIBUTES and OCTAHEDRAL"),
        ({"mode": "INDICES", "byteStride": 8, "count": 12}, "8 bytes of INDICES and NONE"),
        ({"mode": "INDICES", "filter": "COLOR"}, "INDICES and COLOR"),
        ({"mode": "TRIANGLES", "byteStride": 2, "count": 48}, "cannot be decoded"),
        ({"mode": "TRIANGLES", "byteStride": 2, "count": 47}, "not possible with 47"),
        ({"mode": "INDICES"}, "cannot be decoded"),
        ({"byteStride": 8, "count": 12}, "cannot be decoded"),
        ({"byteLength": 30}, "cannot be decoded"),
        ({"byteLength": 0}, "cannot be decoded"),
        ({"byteOffset": -4}, "reach beyond their buffer"),
        ({"byteLength": 10**6}, "reach beyond their buffer"),
        ({"buffer": 7}, "entry 7 of buffers"),
    ],
)
def test_damaged_meshopt_views(gltf, meshoptimizer, change, said):
    rows = RANDOM.integers(0, 256, (24, 4)).astype("u1")
    view = add_meshopt(gltf, encode_rows(meshoptimizer, rows), 24, 4, "ATTRIBUTES")
    gltf.json["bufferViews"][view]["extensions"][EXT].update(change)
    refused(close(gltf, 96), said)


@pytest.mark.parametrize("mode", ["ATTRIBUTES", "TRIANGLES", "INDICES"])
def test_mutated_meshopt_streams_do_no_harm(gltf, meshoptimizer, mode):
    meshoptimizer.encode_vertex_version(1)
    encode = {
        "ATTRIBUTES": meshoptimizer.encode_vertex_buffer,
        "TRIANGLES": meshoptimizer.encode_index_buffer,
        "INDICES": meshoptimizer.encode_index_sequence,
    }[mode]
    stream = encode(TRIANGLES.reshape(-1))
    view = add_meshopt(gltf, stream, TRIANGLES.size, 4, mode)
    document = close(gltf, TRIANGLES.size * 4)
    for seed in range(300):
        random = np.random.default_rng(seed)
        data = bytearray(document.buffers[0])
        for _ in range(random.integers(1, 4)):
            data[random.integers(len(stream))] = random.integers(256)
        try:
            plain = decompress(GltfDocument(document.path, document.json, (bytes(data), b"")))
        except InputError:
            continue
        assert len(view_bytes(plain, view)) == TRIANGLES.size * 4, f"seed {seed}"


def meshopt_beside_plain(gltf):
    """Make a buffer view with plain bytes beside what is no stream of meshoptimizer."""
    view = add_meshopt(gltf, b"none", COUNT, 12, "ATTRIBUTES", buffer=0, byteOffset=len(gltf.data) + 4)
    gltf.data += POINTS.tobytes()
    gltf.accessor(POINTS, bufferView=view)
    return view


def test_plain_data_beside_meshopt_are_kept(gltf):
    view = meshopt_beside_plain(gltf)
    document = close(gltf)
    plain = decompress(document)
    assert "extensions" not in plain.json["bufferViews"][view]
    assert np.array_equal(raw_values(plain, 0), POINTS)
    assert plain.buffers == document.buffers


def test_plain_data_beside_meshopt_that_is_required(gltf, meshoptimizer, monkeypatch):
    meshopt_beside_plain(gltf)
    require(gltf, EXT)
    refused(close(gltf), "cannot be decoded")
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    assert np.array_equal(raw_values(decompress(close(gltf)), 0), POINTS)


@pytest.mark.parametrize("extension", [EXT, KHR])
def test_meshopt_without_its_library(gltf, monkeypatch, extension):
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    add_meshopt(gltf, b"none", 4, 4, "ATTRIBUTES", extension)
    said = f"compressed by {extension}, which needs the package meshoptimizer; `pip install 'aoprecalc[compressed]'`"
    refused(close(gltf, 16), said)


def test_a_library_that_cannot_be_loaded(gltf, monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "meshoptimizer", raising=False)
    (tmp_path / "meshoptimizer.py").write_text("raise ImportError('of another machine')")
    monkeypatch.syspath_prepend(tmp_path)
    add_meshopt(gltf, b"none", 4, 4, "ATTRIBUTES")
    refused(close(gltf, 16), "cannot be loaded (of another machine); install it again")
