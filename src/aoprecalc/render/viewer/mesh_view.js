/* AoView.MeshView: one mesh on a canvas that the reader of a report turns, drawn by three.js (the global THREE).

   const view = new AoView.MeshView(canvas, asset, { onerror(error) { ... show the still picture ... } });
   view.setMode("ao");      // or "material", "spheres", "checker", "error"; see view.modes
   view.ready               // a promise: true once the first picture is drawn, false after onerror
   view.resize()            // the canvas has another size; it is watched, so that pages seldom call this
   view.render()            // draw now; canvas.toDataURL() in the same task then holds the picture
   view.reset()             // the camera of the beginning (key 0)
   view.dispose()           // free everything; the canvas can take no other view afterwards

   `asset` is plain JSON; nothing in it is fetched from the network:

   geometry   what Python's `ViewGeometry.as_json()` returns: the simplified mesh, packed
   textures   { ao, error, base }: addresses of pictures (data: or blob:), each null or missing where there is none
                ao      grey, linear: 255 is open; row 0 at v = 1
                error   the heat map in its colours, sRGB, padded across the borders of charts as the AO texture is
                base    an array: the pictures of `ViewGeometry.base_textures`, in their order, sRGB
   spheres    what Python's `ViewGeometry.pack_spheres(centers, radii)` returns, or null
   up         "y" or "z": the axis of the mesh that points up
   label      says what is shown, for screen readers: "bigguy.obj, 3D view"

   The canvas needs a size by CSS, and nothing else: the view makes it focusable and sets role, aria-label and
   touch-action. Drag, or one finger sideways, turns the mesh (up and down scrolls the page on touch screens); two fingers,
   the wheel while the canvas has the focus or Ctrl is held, + and - zoom; the arrow keys turn; 0 resets. The background is
   transparent. It draws only when something has changed.

   `onerror` is called once, with an Error, where there is no WebGL, a picture or the geometry cannot be read, or the
   graphics context was lost and did not come back; the page then shows the still picture.                          */

"use strict";

var AoView = (() => {
  const FIELD_OF_VIEW = 30; // degrees, of the smaller side of the canvas
  const START = { azimuth: 35, elevation: 18, distance: 1 }; // degrees; 1: the mesh fills the canvas
  const NEAREST = 0.15, FARTHEST = 4; // distances, as above
  const TURN_STEP = 10, ZOOM_STEP = 1.15; // of one key
  const MAX_PIXEL_RATIO = 2;
  const MAX_SPHERE_TRIANGLES = 400000; // of all spheres together
  const RESTORE_MS = 4000; // how long a lost graphics context may take to come back
  const CLAY = 0.62, SPHERE_COLOR = [0.16, 0.34, 0.52]; // linear
  const FAINT = 0.35; // opacity of the mesh around its spheres

  // ------------------------------------------------------------------------------------------------ unpacking

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
    add("base", 3, Float32Array.from(surface.flatMap(({ color }) => color || [CLAY, CLAY, CLAY])));
    geometry.setIndex(new THREE.BufferAttribute(index, 1));

    const textureOf = (corner) => surface[index[corner]].texture ?? -1;
    for (let start = 0, end = 3; start < index.length; end += 3)
      if (end >= index.length || textureOf(end) !== textureOf(start)) {
        geometry.addGroup(start, end - start, textureOf(start) + 1);
        start = end;
      }
    return geometry;
  }

  // ------------------------------------------------------------------------------------------------ pictures

  function imageOf(address) {
    return new Promise((resolve, reject) => {
      const image = new Image();
      image.onload = () => resolve(image);
      image.onerror = () => reject(new Error("a texture cannot be read"));
      image.src = address;
    });
  }

  function textureOf(image, colorSpace, renderer) {
    const texture = image instanceof HTMLCanvasElement ? new THREE.CanvasTexture(image) : new THREE.Texture(image);
    texture.colorSpace = colorSpace;
    texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
    texture.anisotropy = Math.min(8, renderer.capabilities.getMaxAnisotropy());
    texture.needsUpdate = true;
    return texture;
  }

  /** A UV checker: 8 x 8 fields with letters along u, digits along v and a hue of their own, each of 4 x 4 squares. */
  function checkerImage() {
    const fields = 8, squares = 4, size = 1024, field = size / fields, square = field / squares;
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = size;
    const draw = canvas.getContext("2d");
    draw.textAlign = "center";
    draw.textBaseline = "middle";
    draw.font = `bold ${field * 0.42}px sans-serif`;
    for (let column = 0; column < fields; column++)
      for (let row = 0; row < fields; row++) {
        const x = column * field, y = row * field, hue = (360 * (column + 3 * row)) / (fields * 3);
        for (let i = 0; i < squares * squares; i++) {
          const across = i % squares, down = Math.floor(i / squares);
          draw.fillStyle = `hsl(${hue} 55% ${(across + down) % 2 ? 78 : 58}%)`;
          draw.fillRect(x + across * square, y + down * square, square, square);
        }
        draw.fillStyle = "rgb(20 20 25 / 85%)";
        draw.fillText("ABCDEFGH"[column] + (fields - row), x + field / 2, y + field / 2);
      }
    return canvas;
  }

  // ------------------------------------------------------------------------------------------------ shading

  const VERTEX_SHADER = `
    attribute vec2 baseUv;
    attribute float textured;
    attribute vec3 base;
    varying vec3 vNormal, vView, vBase;
    varying vec2 vUv, vBaseUv;
    varying float vTextured;

    void main() {
      vec4 place = vec4(position, 1.0);
      vec3 direction = normal;
      #ifdef USE_INSTANCING
        place = instanceMatrix * place; // a sphere: its matrix scales all axes alike
      #endif
      vec4 world = modelMatrix * place;
      vNormal = mat3(modelMatrix) * direction;
      vView = cameraPosition - world.xyz;
      vUv = uv;
      vBaseUv = baseUv;
      vTextured = textured;
      vBase = base;
      gl_Position = projectionMatrix * viewMatrix * world;
    }`;

  // The lights stand still relative to the camera: a key light from above on the left, a soft fill from the right, and
  // a sky that is lighter than the ground. MODE: 0 AO, 1 base colours, 2 a picture in its own colours, 3 one colour.
  const FRAGMENT_SHADER = `
    uniform sampler2D occlusion, picture;
    uniform vec3 color, key, fill, up;
    uniform float opacity;
    varying vec3 vNormal, vView, vBase;
    varying vec2 vUv, vBaseUv;
    varying float vTextured;

    float wrapped(float cosine, float wrap) {
      return max(cosine + wrap, 0.0) / (1.0 + wrap);
    }

    void main() {
      vec3 n = normalize(vNormal), v = normalize(vView);
      if (dot(n, v) < 0.0) n = reflect(n, v); // normals of back faces, and of silhouettes
      float light = 0.62 * wrapped(dot(n, key), 0.25) + 0.16 * wrapped(dot(n, fill), 0.4)
        + mix(0.20, 0.44, 0.5 + 0.5 * dot(n, up));
      float rim = pow(1.0 - max(dot(n, v), 0.0), 4.0);
      vec3 half_way = normalize(key + v);
      float gloss = 0.05 * pow(max(dot(n, half_way), 0.0), 24.0);
      float open = 1.0;
      #ifdef HAS_OCCLUSION
        open = mix(1.0, texture2D(occlusion, vUv).r, vTextured);
      #endif
      vec3 albedo = color;
      #if MODE == 1
        albedo = vBase;
        #ifdef HAS_PICTURE
          albedo *= texture2D(picture, vBaseUv).rgb;
        #endif
      #elif MODE == 2
        albedo = mix(color, texture2D(picture, vUv).rgb, vTextured);
        light = mix(1.0, light, 0.35);
        gloss = rim = 0.0;
      #endif
      gl_FragColor = vec4(open * (albedo * (light + 0.10 * rim) + gloss), opacity);
      #include <colorspace_fragment>
    }`;

  function material(mode, textures = {}, color = [CLAY, CLAY, CLAY]) {
    const { occlusion = null, picture = null } = textures;
    const defines = { MODE: mode };
    if (occlusion) defines.HAS_OCCLUSION = "";
    if (picture) defines.HAS_PICTURE = "";
    const uniforms = {
      occlusion: { value: occlusion },
      picture: { value: picture },
      color: { value: new THREE.Color(...color) },
      key: { value: new THREE.Vector3() },
      fill: { value: new THREE.Vector3() },
      up: { value: new THREE.Vector3(0, 1, 0) },
      opacity: { value: 1 },
    };
    const made = new THREE.ShaderMaterial({
      defines, uniforms, vertexShader: VERTEX_SHADER, fragmentShader: FRAGMENT_SHADER, side: THREE.DoubleSide,
    });
    return made;
  }

  /** All spheres as instances of one; more triangles for each where there are fewer. */
  function sphereMesh(packed) {
    const spheres = new Float32Array(bytesOf(packed).buffer), count = spheres.length / 4;
    const detail = Math.sqrt(MAX_SPHERE_TRIANGLES / 20 / Math.max(count, 1)) - 1;
    const geometry = new THREE.IcosahedronGeometry(1, Math.round(Math.min(Math.max(detail, 2), 14)));
    const mesh = new THREE.InstancedMesh(geometry, material(3, {}, SPHERE_COLOR), count);
    const matrix = new THREE.Matrix4();
    for (let i = 0; i < count; i++) {
      const [x, y, z, radius] = spheres.subarray(4 * i, 4 * i + 4);
      mesh.setMatrixAt(i, matrix.makeScale(radius, radius, radius).setPosition(x, y, z));
    }
    return mesh;
  }

  // ------------------------------------------------------------------------------------------------ the view

  class MeshView {
    /** See the head of this file. */
    constructor(canvas, asset, { onerror = () => {} } = {}) {
      this.canvas = canvas;
      this.asset = asset;
      this.mode = "ao";
      this.modes = ["ao"];
      this.onerror = onerror;
      this.freed = []; // what dispose() frees
      this.listeners = new AbortController();
      this.reset();
      this.ready = this.#start().then(() => true, (error) => this.#fail(error));
    }

    async #start() {
      const { canvas, asset } = this;
      this.renderer = new THREE.WebGLRenderer({ canvas, alpha: true, antialias: true, powerPreference: "low-power" });
      this.renderer.setClearColor(0, 0);
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera();
      this.turned = new THREE.Group(); // from the mesh's axes to y upwards
      if (asset.up === "z") this.turned.rotation.x = -Math.PI / 2;
      if (asset.up === "x") this.turned.rotation.z = Math.PI / 2;
      this.scene.add(this.turned);
      this.#listen();

      const { ao, error, base = [] } = asset.textures || {};
      const color = asset.geometry.surfaces.some((surface) => surface.color);
      const [geometry, aoImage, errorImage, ...baseImages] = await Promise.all([
        meshGeometry(asset.geometry),
        ...[ao, error, ...base].map((address) => (address ? imageOf(address) : null)),
      ]);
      if (this.disposed) return;
      const texture = (image, space) => image && this.#free(textureOf(image, space, this.renderer));
      const occlusion = texture(aoImage, THREE.NoColorSpace);
      this.#free(geometry);
      this.materials = { ao: [material(0, { occlusion })], spheres: [material(0, { occlusion })] };
      if (color) {
        const pictures = [null, ...baseImages.map((image) => texture(image, THREE.SRGBColorSpace))];
        this.materials.material = pictures.map((picture) => material(1, { occlusion, picture }));
      }
      if (asset.geometry.columns.some(({ name }) => name === "u"))
        this.materials.checker = [material(2, { picture: texture(checkerImage(), THREE.SRGBColorSpace) })];
      if (errorImage) this.materials.error = [material(2, { picture: texture(errorImage, THREE.SRGBColorSpace) })];
      for (const one of Object.values(this.materials).flat()) this.#free(one);
      const [faint] = this.materials.spheres;
      faint.uniforms.opacity.value = FAINT;
      faint.transparent = true;

      this.mesh = new THREE.Mesh(geometry, this.materials.ao[0]);
      this.turned.add(this.mesh);
      if (asset.spheres) {
        this.spheres = sphereMesh(asset.spheres);
        this.#free(this.spheres, this.spheres.geometry, this.spheres.material);
        this.turned.add(this.spheres);
      } else delete this.materials.spheres;
      this.modes = ["ao", "material", "spheres", "checker", "error"].filter((mode) => this.materials[mode]);
      this.resize();
      this.render();
    }

    /** Show the mesh in another way; one that the asset has nothing for is shown as "ao". */
    setMode(mode) {
      this.mode = mode;
      this.#changed();
    }

    /** The camera of the beginning. */
    reset() {
      Object.assign(this, START);
      this.#changed();
    }

    /** Draw as many pixels as the canvas has on the page. */
    resize() {
      const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
      if (!this.renderer || this.disposed || !width || !height) return;
      this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, MAX_PIXEL_RATIO));
      this.renderer.setSize(width, height, false);
      this.#changed();
    }

    /** Draw now. */
    render() {
      this.waiting = false;
      if (!this.mesh || this.disposed || this.lost) return;
      const mode = this.modes.includes(this.mode) ? this.mode : "ao", { camera } = this;
      this.#placeCamera();
      const materials = this.materials[mode];
      this.mesh.material = mode === "material" ? materials : materials[0]; // an array: one for each group of triangles
      if (this.spheres) this.spheres.visible = mode === "spheres";
      for (const one of [...materials, ...(this.spheres ? [this.spheres.material] : [])]) {
        one.uniforms.key.value.set(-0.45, 0.75, 0.55).normalize().applyQuaternion(camera.quaternion);
        one.uniforms.fill.value.set(0.8, 0.1, 0.5).normalize().applyQuaternion(camera.quaternion);
      }
      this.renderer.render(this.scene, camera);
    }

    /** Free all memory of the graphics card and stop listening. */
    dispose() {
      if (this.disposed) return;
      this.disposed = true;
      this.listeners.abort();
      this.watcher?.disconnect();
      clearTimeout(this.restoring);
      for (const one of this.freed) one.dispose();
      this.renderer?.dispose();
      this.renderer?.forceContextLoss();
    }

    // ---------------------------------------------------------------------------------------------- inside

    #free(...values) {
      this.freed.push(...values);
      return values[0];
    }

    #fail(error) {
      if (this.disposed) return false;
      this.dispose();
      this.onerror(error instanceof Error ? error : new Error(String(error)));
      return false;
    }

    #changed() {
      if (this.waiting || this.disposed) return;
      this.waiting = true;
      requestAnimationFrame(() => this.render());
    }

    #placeCamera() {
      const { camera, canvas } = this;
      const aspect = canvas.clientWidth / canvas.clientHeight || 1;
      const half = (FIELD_OF_VIEW / 2) * (Math.PI / 180);
      camera.aspect = aspect;
      camera.fov = (360 / Math.PI) * (aspect < 1 ? Math.atan(Math.tan(half) / aspect) : half);
      const distance = this.distance / Math.sin(half); // the unit sphere touches the smaller sides
      camera.near = Math.max(distance - 1.5, distance / 100);
      camera.far = distance + 1.5;
      const azimuth = (this.azimuth * Math.PI) / 180, elevation = (this.elevation * Math.PI) / 180;
      camera.position
        .set(Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation), Math.cos(azimuth) * Math.cos(elevation))
        .multiplyScalar(distance);
      camera.lookAt(0, 0, 0);
      camera.updateProjectionMatrix();
      camera.updateMatrixWorld();
    }

    #turn(degreesAcross, degreesUp) {
      this.azimuth = (this.azimuth + degreesAcross) % 360;
      this.elevation = Math.min(Math.max(this.elevation + degreesUp, -89), 89);
      this.#changed();
    }

    #zoom(factor) {
      this.distance = Math.min(Math.max(this.distance * factor, NEAREST), FARTHEST);
      this.#changed();
    }

    #listen() {
      const { canvas, asset } = this, pointers = new Map();
      const listen = (name, action) =>
        canvas.addEventListener(name, action, { signal: this.listeners.signal, passive: false });
      canvas.tabIndex = 0;
      canvas.style.touchAction = "pan-y";
      canvas.setAttribute("role", "img");
      canvas.setAttribute(
        "aria-label",
        `${asset.label || "3D view of the mesh"}. Arrow keys turn it, plus and minus zoom, 0 resets.`,
      );

      const spread = () => {
        const [a, b] = [...pointers.values()];
        return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) || 1;
      };
      listen("pointerdown", (event) => {
        canvas.focus({ preventScroll: true });
        canvas.setPointerCapture(event.pointerId);
        pointers.set(event.pointerId, event);
      });
      listen("pointermove", (event) => {
        const before = pointers.get(event.pointerId);
        if (!before) return;
        const apart = pointers.size === 2 && spread();
        pointers.set(event.pointerId, event);
        if (apart) this.#zoom(apart / spread());
        else if (pointers.size === 1) {
          const scale = 240 / Math.min(canvas.clientWidth, canvas.clientHeight);
          this.#turn((before.clientX - event.clientX) * scale, (event.clientY - before.clientY) * scale);
        }
      });
      for (const name of ["pointerup", "pointercancel", "lostpointercapture"])
        listen(name, (event) => pointers.delete(event.pointerId));
      listen("wheel", (event) => {
        if (document.activeElement !== canvas && !event.ctrlKey) return;
        event.preventDefault();
        this.#zoom(Math.exp(Math.max(-1, Math.min(1, event.deltaY / (event.deltaMode ? 10 : 300)))));
      });
      const keys = {
        ArrowLeft: () => this.#turn(-TURN_STEP, 0),
        ArrowRight: () => this.#turn(TURN_STEP, 0),
        ArrowUp: () => this.#turn(0, TURN_STEP),
        ArrowDown: () => this.#turn(0, -TURN_STEP),
        "+": () => this.#zoom(1 / ZOOM_STEP),
        "=": () => this.#zoom(1 / ZOOM_STEP),
        "-": () => this.#zoom(ZOOM_STEP),
        0: () => this.reset(),
      };
      listen("keydown", (event) => {
        if (event.ctrlKey || event.altKey || event.metaKey || !keys[event.key]) return;
        event.preventDefault();
        keys[event.key]();
      });

      listen("webglcontextlost", (event) => {
        event.preventDefault();
        this.lost = true;
        this.restoring = setTimeout(() => this.#fail(new Error("the graphics context was lost")), RESTORE_MS);
      });
      listen("webglcontextrestored", () => {
        this.lost = false;
        clearTimeout(this.restoring);
        this.#changed();
      });
      this.watcher = new ResizeObserver(() => this.resize());
      this.watcher.observe(canvas);
    }
  }

  return { MeshView, unpacked, THREE_REVISION: THREE.REVISION };
})();
