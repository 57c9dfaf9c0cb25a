/* The geometry of the 3D view, unpacked from what Python's `ViewGeometry.as_json()` returns; see `ViewGeometry.packed`. */

"use strict";

var AoView = { THREE_REVISION: THREE.REVISION };

(() => {
  /** The bytes of a base64 text. */
  function bytesOf(base64) {
    return Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  }

  /** The bytes of a zlib stream. */
  async function inflated(bytes) {
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /** Unpack `ViewGeometry.as_json()`: { index, columns: { x, y, z, ... } }; see `ViewGeometry.packed`. */
  async function unpacked(geometry) {
    const bytes = await inflated(bytesOf(geometry.data));
    const corners = 3 * geometry.triangles, count = geometry.vertices;
    if (bytes.length !== 3 * corners + 2 * count * geometry.columns.length) throw new Error("the geometry is damaged");
    let start = 0;
    const planes = (length, number) => {
      const values = new Uint32Array(length);
      for (let plane = 0; plane < number; plane++)
        for (let i = 0; i < length; i++) values[i] |= bytes[start++] << (8 * plane);
      return values;
    };

    const index = planes(corners, 3);
    let unused = 0;
    for (let i = 0; i < corners; i++) {
      const vertex = unused - index[i];
      if (vertex === unused) unused++;
      index[i] = vertex;
    }
    const columns = {};
    for (const { name, lower, step } of geometry.columns) {
      const coded = planes(count, 2), numbers = new Float32Array(count);
      let value = 0;
      for (let i = 0; i < count; i++) {
        value = (value + ((coded[i] >> 1) ^ -(coded[i] & 1))) & 0xffff;
        numbers[i] = lower + step * value;
      }
      columns[name] = numbers;
    }
    return { index: count > 65535 ? index : Uint16Array.from(index), columns };
  }

  /** Columns side by side: [a0, b0, a1, b1, ...]. */
  function interleaved(...columns) {
    const joined = new Float32Array(columns.length * columns[0].length);
    columns.forEach((column, k) => column.forEach((value, i) => (joined[i * columns.length + k] = value)));
    return joined;
  }

  /** Unit vectors of the octahedral map. */
  function normalsOf({ nu, nv }) {
    const normals = new Float32Array(3 * nu.length);
    for (let i = 0; i < nu.length; i++) {
      const z = 1 - Math.abs(nu[i]) - Math.abs(nv[i]), fold = Math.max(-z, 0);
      const x = nu[i] - Math.sign(nu[i]) * fold, y = nv[i] - Math.sign(nv[i]) * fold;
      const length = Math.hypot(x, y, z) || 1;
      normals.set([x / length, y / length, z / length], 3 * i);
    }
    return normals;
  }

  /** The geometry of the mesh, with a group of triangles for each base texture. */
  async function meshGeometry(packed) {
    const { index, columns } = await unpacked(packed);
    const geometry = new THREE.BufferGeometry();
    const zeros = new Float32Array(packed.vertices);
    const add = (name, size, values) => geometry.setAttribute(name, new THREE.BufferAttribute(values, size));
    add("position", 3, interleaved(columns.x, columns.y, columns.z));
    add("normal", 3, normalsOf(columns));
    add("uv", 2, interleaved(columns.u || zeros, columns.v || zeros));
    add("baseUv", 2, interleaved(columns.u1 || zeros, columns.v1 || zeros));
    const surface = Array.from(columns.surface, (number) => packed.surfaces[Math.round(number)]);
    add("textured", 1, Float32Array.from(surface, ({ textured }) => (textured ? 1 : 0)));
    add("strength", 1, Float32Array.from(surface, ({ textured, strength }) => (textured ? strength : 0)));
    add("base", 3, Float32Array.from(surface.flatMap(({ color }) => color || AoView.CLAY)));
    geometry.setIndex(new THREE.BufferAttribute(index, 1));

    const textureOf = (corner) => surface[index[corner]].texture ?? -1;
    for (let start = 0, end = 3; start < index.length; end += 3)
      if (end >= index.length || textureOf(end) !== textureOf(start)) {
        geometry.addGroup(start, end - start, textureOf(start) + 1);
        start = end;
      }
    return geometry;
  }

  Object.assign(AoView, { bytesOf, unpacked, meshGeometry });
})();
