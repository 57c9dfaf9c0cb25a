/* AoView.MeshView: one mesh on a canvas that the reader of a report turns, drawn by three.js (the global THREE).

   const view = new AoView.MeshView(canvas, asset, { onerror(error) { ... show the still picture ... } });
   view.setMode("ao");      // or "material", "spheres", "checker", "error"; view.modes has those that the asset allows
   view.ready               // a promise: true once the first picture is drawn, false after onerror
   view.resize()            // the canvas has another size; it is watched, so that pages seldom call this
   view.render()            // draw now; canvas.toDataURL() in the same task then holds the picture
   view.reset()             // the camera of the beginning (key 0)
   view.memory()            // { geometries, textures } on the graphics card, for tests
   view.dispose()           // free everything; the canvas can take no other view afterwards

   `asset` is plain JSON; nothing in it is fetched from the network:

   geometry   what Python's `ViewGeometry.as_json()` returns: the simplified mesh, packed
   textures   { ao, error, base }: addresses of pictures (data: or blob:), each null or missing where there is none
                ao      grey, linear: 255 is open; row 0 at v = 1
                error   the heat map in its colours, sRGB, padded across the borders of charts as the AO texture is
                base    an array: the pictures of `ViewGeometry.base_textures`, in their order, sRGB
   spheres    what Python's `ViewGeometry.pack_spheres(centers, radii)` returns, or null
   up         "x", "y" or "z": the axis of the mesh that points up
   label      says what is shown, for screen readers: "bigguy.obj, 3D view"

   The canvas needs a size by CSS, and nothing else: the view makes it focusable and sets role, aria-label and
   touch-action. Drag, or one finger sideways, turns the mesh (up and down scrolls the page on touch screens); with Shift or
   the right button it moves. Two fingers, the wheel while the canvas has the focus or Ctrl is held, + and - zoom; the arrow
   keys turn, with Shift they move; 0 resets. The background is transparent. It draws only when something has changed.

   `onerror` is called once, with an Error, where there is no WebGL, a picture or the geometry cannot be read, or the
   graphics context was lost and did not come back; the page then shows the still picture.                          */

"use strict";

(() => {
  const TANGENT = Math.tan((13 * Math.PI) / 180); // of half the angle of view along the height, as in camera.py
  const START = { azimuth: 24, elevation: 20, zoom: 1, moved: [0, 0] }; // degrees; moved: in radii of the mesh
  const KEY_LIGHT = { turn: -48, rise: 52 }; // degrees from the camera's azimuth, above the ground; as in preview.py
  const MARGIN = 1.08; // around the mesh
  const MIN_ZOOM = 0.3, MAX_ZOOM = 12;
  const TURN_STEP = 10, MOVE_STEP = 0.1, ZOOM_STEP = 1.15; // of one key
  const TOUCH_SLOP = 5; // pixels that a finger moves sideways before it turns the mesh
  const MAX_PIXEL_RATIO = 2;
  const RESTORE_MS = 4000; // how long a lost graphics context may take to come back
  const FAINT = 0.35; // opacity of the mesh around its spheres
  const UPWARDS = { x: ["z", Math.PI / 2], y: ["y", 0], z: ["x", -Math.PI / 2] }; // turns that axis to y
  const FRONT = { side: THREE.FrontSide }; // the back lies a little deeper: thin walls, simplified, may cross each other
  const BACK = { side: THREE.BackSide, polygonOffset: true, polygonOffsetUnits: 20000 }; // of 2^-24 of the depths
  const MODES = ["ao", "material", "spheres", "checker", "error"];

  const radians = (degrees) => (degrees * Math.PI) / 180;
  const limited = (value, low, high) => Math.min(Math.max(value, low), high);

  /** The unit vector towards a point on the orbit; angles in degrees, azimuth 0 is along z. */
  function towards(azimuth, elevation) {
    const [turn, rise] = [radians(azimuth), radians(elevation)];
    return [Math.sin(turn) * Math.cos(rise), Math.sin(rise), Math.cos(turn) * Math.cos(rise)];
  }

  /** How far the camera has to be so that the points, [x, y, z, ...] with y up, are in view from wherever it turns to. */
  function distanceToFit(points, elevation, aspect) {
    let distance = 0;
    const rise = radians(elevation), [sine, cosine] = [Math.sin(rise), Math.cos(rise)];
    for (let azimuth = START.azimuth; azimuth < START.azimuth + 360; azimuth += 22.5) {
      const turn = radians(azimuth), [s, c] = [Math.sin(turn), Math.cos(turn)];
      for (let i = 0; i < points.length; i += 3) {
        const across = points[i] * c - points[i + 2] * s, along = points[i] * s + points[i + 2] * c;
        const up = points[i + 1] * cosine - along * sine, depth = points[i + 1] * sine + along * cosine;
        const needed = Math.max(Math.abs(across) / aspect, Math.abs(up)) / TANGENT + depth;
        if (needed > distance) distance = needed;
      }
    }
    return Math.max(distance, 0.1) * MARGIN;
  }

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
      const context = canvas.getContext("webgl2", { alpha: true, antialias: true, powerPreference: "low-power" });
      if (!context) throw new Error("this browser has no WebGL 2, or has it switched off");
      this.renderer = new THREE.WebGLRenderer({ canvas, context });
      this.renderer.setClearColor(0, 0);
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera();
      this.turned = new THREE.Group(); // from the mesh's axes to y upwards
      const [axis, angle] = UPWARDS[asset.up] || UPWARDS.y;
      this.turned.rotation[axis] = angle;
      this.turned.updateMatrixWorld();
      this.scene.add(this.turned);
      this.#listen();

      const { ao, error, base = [] } = asset.textures || {};
      const [geometry, ...images] = await Promise.all([
        AoView.meshGeometry(asset.geometry), ...[ao, error, ...base].map(AoView.imageOf),
      ]);
      if (this.disposed) return;
      this.#build(geometry, images);
      this.resize();
      this.render();
    }

    /** Make everything that can be shown. */
    #build(geometry, [ao, error, ...base]) {
      const { asset } = this, { surfaces, columns } = asset.geometry;
      const texture = (image, space) => image && this.#free(AoView.textureOf(image, space, this.renderer));
      const sides = (look, ...all) =>
        [FRONT, BACK].map((side) => all.map((pictures) => this.#free(AoView.material(look, pictures, side))));
      const occlusion = texture(ao, THREE.NoColorSpace);
      this.materials = { ao: sides(0, { occlusion }) }; // by mode: those of the front, then of the back
      if (surfaces.some(({ color }) => color)) {
        const pictures = [null, ...base.map((image) => texture(image, THREE.SRGBColorSpace))];
        this.materials.material = sides(1, ...pictures.map((picture) => ({ occlusion, picture })));
      }
      if (columns.some(({ name }) => name === "u"))
        this.materials.checker = sides(2, { picture: texture(AoView.checkerImage(), THREE.SRGBColorSpace) });
      if (error) this.materials.error = sides(2, { picture: texture(error, THREE.SRGBColorSpace) });
      this.meshes = this.materials.ao.map(([first]) => new THREE.Mesh(geometry, first));
      this.#free(geometry);
      this.turned.add(...this.meshes);
      if (asset.spheres) this.#buildSpheres(geometry, occlusion);
      this.modes = MODES.filter((mode) => this.materials[mode]);
      this.points = geometry.getAttribute("position").clone().applyMatrix4(this.turned.matrixWorld).array;
    }

    /** Spheres, over which the mesh lies faintly; its depths come first, so that it shows one layer of itself. */
    #buildSpheres(geometry, occlusion) {
      const faint = { ...FRONT, transparent: true, opacity: FAINT };
      this.materials.spheres = [[this.#free(AoView.material(0, { occlusion }, faint))]];
      this.spheres = AoView.sphereMesh(this.asset.spheres);
      this.depths = new THREE.Mesh(geometry, this.#free(AoView.material(0, {}, { ...faint, colorWrite: false })));
      this.meshes[0].renderOrder = 1;
      this.#free(this.spheres, this.spheres.geometry, this.spheres.material);
      this.turned.add(this.spheres, this.depths);
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
      if (!this.points || this.disposed || !width || !height) return;
      this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, MAX_PIXEL_RATIO));
      this.renderer.setSize(width, height, false);
      this.distance = distanceToFit(this.points, START.elevation, width / height);
      this.camera.aspect = width / height;
      this.#changed();
    }

    /** Draw now. */
    render() {
      this.waiting = false;
      if (!this.distance || this.disposed || this.lost) return;
      const mode = this.modes.includes(this.mode) ? this.mode : "ao", sides = this.materials[mode];
      this.meshes.forEach((mesh, side) => {
        const materials = sides[side];
        mesh.visible = Boolean(materials);
        if (materials) mesh.material = mode === "material" ? materials : materials[0]; // an array: one for each group
      });
      if (this.spheres) this.spheres.visible = this.depths.visible = mode === "spheres";
      this.#placeCamera();
      const key = towards(this.azimuth + KEY_LIGHT.turn, KEY_LIGHT.rise);
      for (const one of [...sides.flat(), this.spheres?.material]) one?.uniforms.key.value.set(...key);
      this.renderer.render(this.scene, this.camera);
    }

    /** What is on the graphics card. */
    memory() {
      const { geometries = 0, textures = 0 } = this.renderer?.info.memory ?? {};
      return { geometries, textures };
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
      if (!this.lost) this.renderer?.forceContextLoss();
    }

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
      const { camera } = this, distance = this.distance / this.zoom;
      camera.fov = (2 * Math.atan(TANGENT) * 180) / Math.PI;
      camera.near = Math.max(distance - 1.1, distance / 100); // the mesh is in the unit sphere, its spheres nearly so
      camera.far = distance + 1.5;
      camera.position.set(...towards(this.azimuth, this.elevation)).multiplyScalar(distance);
      camera.lookAt(0, 0, 0);
      camera.translateX(-this.moved[0]);
      camera.translateY(-this.moved[1]);
      camera.updateProjectionMatrix();
      camera.updateMatrixWorld();
    }

    #turn(degreesAcross, degreesUp) {
      this.azimuth = (this.azimuth + degreesAcross) % 360;
      this.elevation = limited(this.elevation + degreesUp, -90, 90);
      this.#changed();
    }

    #move(across, up) {
      this.moved = [limited(this.moved[0] + across, -1, 1), limited(this.moved[1] + up, -1, 1)];
      this.#changed();
    }

    #zoom(factor) {
      this.zoom = limited(this.zoom * factor, MIN_ZOOM, MAX_ZOOM);
      this.#changed();
    }

    #listen() {
      const { canvas, asset } = this, { signal } = this.listeners;
      const listen = (name, action) => canvas.addEventListener(name, action, { signal, passive: false });
      canvas.tabIndex = 0;
      canvas.style.touchAction = "pan-y";
      canvas.setAttribute("role", "application");
      canvas.setAttribute("aria-roledescription", "3D view");
      const help = "Arrow keys turn it, with Shift they move it; plus and minus zoom, 0 resets.";
      canvas.setAttribute("aria-label", `${asset.label || "3D view of the mesh"}. ${help}`);
      this.#listenToPointers(listen);

      listen("wheel", (event) => {
        if (document.activeElement !== canvas && !event.ctrlKey) return;
        event.preventDefault();
        this.#zoom(Math.exp(limited(-event.deltaY / (event.deltaMode ? 10 : 300), -1, 1)));
      });
      const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
      const zooms = { "+": ZOOM_STEP, "=": ZOOM_STEP, "-": 1 / ZOOM_STEP, _: 1 / ZOOM_STEP };
      listen("keydown", (event) => {
        const { key } = event, [across, up] = arrows[key] ?? [];
        if (event.ctrlKey || event.altKey || event.metaKey) return;
        if (key in arrows && event.shiftKey) this.#move(across * MOVE_STEP, up * MOVE_STEP);
        else if (key in arrows) this.#turn(across * TURN_STEP, up * TURN_STEP);
        else if (key in zooms) this.#zoom(zooms[key]);
        else if (key === "0") this.reset();
        else return;
        event.preventDefault();
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

    /** Drag to turn, with Shift or another button to move; two fingers zoom and move. One finger up or down scrolls. */
    #listenToPointers(listen) {
      const { canvas } = this, pointers = new Map();
      let turning = false; // one finger has moved sideways
      const middle = () => {
        const all = [...pointers.values()];
        const x = all.reduce((sum, one) => sum + one.clientX, 0) / all.length;
        const y = all.reduce((sum, one) => sum + one.clientY, 0) / all.length;
        return { x, y, spread: Math.hypot(all[0].clientX - x, all[0].clientY - y) };
      };
      listen("pointerdown", (event) => {
        canvas.focus({ preventScroll: true });
        canvas.setPointerCapture(event.pointerId);
        pointers.set(event.pointerId, event);
      });
      listen("pointermove", (event) => {
        if (!pointers.has(event.pointerId)) return;
        const before = middle();
        if (event.pointerType === "touch" && pointers.size === 1 && !turning) {
          const sideways = Math.abs(event.clientX - before.x);
          if (sideways < TOUCH_SLOP || sideways < Math.abs(event.clientY - before.y)) return;
          turning = true;
        }
        pointers.set(event.pointerId, event);
        const now = middle(), across = now.x - before.x, down = now.y - before.y;
        const side = Math.min(canvas.clientWidth, canvas.clientHeight);
        if (pointers.size > 1 || event.shiftKey || event.buttons > 1) {
          const radii = (2 * TANGENT * this.distance) / this.zoom / canvas.clientHeight; // of a pixel
          this.#move(across * radii, -down * radii);
          if (before.spread && now.spread) this.#zoom(now.spread / before.spread);
        } else this.#turn((-240 * across) / side, (240 * down) / side);
      });
      for (const name of ["pointerup", "pointercancel", "lostpointercapture"])
        listen(name, (event) => {
          pointers.delete(event.pointerId);
          turning = turning && pointers.size > 0;
        });
      listen("contextmenu", (event) => event.preventDefault());
    }
  }

  AoView.MeshView = MeshView;
})();
