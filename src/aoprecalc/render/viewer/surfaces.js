/* What the 3D view's surfaces look like: textures, the UV checker, materials in the light of the still pictures, spheres. */

"use strict";

(() => {
  // As in shading.py: linear colours of clay, of spheres, of what insides are multiplied by, and the light.
  const CLAY = [0.66, 0.635, 0.6], SPHERE = [0.24, 0.42, 0.64];
  const LIGHT = `
    const vec3 INSIDE = vec3(0.62, 0.50, 0.44);
    const vec3 SKY = vec3(0.76, 0.79, 0.84), BOUNCE = vec3(0.35, 0.33, 0.31), KEY = vec3(0.60, 0.57, 0.51);
    const float WRAP = 0.242; // the sine of the key light's angular radius
    const float WHITE = 0.74; // multiplies base colours, so that white in full light is white`;
  const MAX_SPHERE_TRIANGLES = 400000; // of all spheres together

  /** Load a picture; resolves to null without an address. */
  function imageOf(address) {
    if (!address) return null;
    return new Promise((resolve, reject) => {
      const image = new Image();
      image.onload = () => resolve(image);
      image.onerror = () => reject(new Error("a texture cannot be read"));
      image.src = address;
    });
  }

  /** A texture that repeats, of an image or a canvas. */
  function textureOf(image, colorSpace, renderer) {
    const texture = new THREE.Texture(image);
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

  const VERTEX_SHADER = `
    attribute vec2 baseUv;
    attribute float textured, strength;
    attribute vec3 base;
    varying vec3 vNormal, vBase;
    varying vec2 vUv, vBaseUv;
    varying float vTextured, vStrength;

    void main() {
      vec4 place = vec4(position, 1.0);
      #ifdef USE_INSTANCING
        place = instanceMatrix * place; // a sphere: its matrix scales all axes alike
      #endif
      vNormal = mat3(modelMatrix) * normal;
      vUv = uv;
      vBaseUv = baseUv;
      vTextured = textured;
      vStrength = strength;
      vBase = base;
      gl_Position = projectionMatrix * modelViewMatrix * place;
    }`;

  // LOOK: 0 one colour; 1 base colours; 2 a picture that says something by its colours, shaded a little.
  const FRAGMENT_SHADER = `
    uniform sampler2D occlusion, picture;
    uniform vec3 color, key;
    uniform float opacity;
    varying vec3 vNormal, vBase;
    varying vec2 vUv, vBaseUv;
    varying float vTextured, vStrength;
    ${LIGHT}

    void main() {
      vec3 n = normalize(vNormal);
      #ifdef FLIP_SIDED // three.js defines it for BackSide
        n = -n;
      #endif
      float cosine = dot(n, key), edge = max(cosine + WRAP, 0.0);
      vec3 ambient = mix(BOUNCE, SKY, 0.5 + 0.5 * n.y);
      float direct = cosine > WRAP ? cosine : edge * edge / (4.0 * WRAP);
      #ifdef HAS_OCCLUSION
        float open = mix(1.0, texture2D(occlusion, vUv).r, vStrength);
        ambient *= open;
        direct *= pow(open, 3.0 - 2.0 * max(cosine, 0.0));
      #endif
      vec3 albedo = color;
      #if LOOK == 1
        albedo = WHITE * vBase;
        #ifdef HAS_PICTURE
          albedo *= texture2D(picture, vBaseUv).rgb;
        #endif
      #elif LOOK == 2
        albedo = mix(color, texture2D(picture, vUv).rgb, vTextured);
        ambient = mix(vec3(0.62), 0.5 * ambient, 0.5);
        direct *= 0.5;
      #endif
      vec3 linear = albedo * (ambient + direct * KEY);
      #if defined(FLIP_SIDED) && LOOK != 2
        linear *= INSIDE;
      #endif
      gl_FragColor = vec4(linear, opacity);
      #include <colorspace_fragment>
    }`;

  /** A material; `look` as in the shader, `occlusion` the ambient-occlusion texture, `picture` the other. */
  function material(look, { occlusion = null, picture = null, color = CLAY } = {}, settings = {}) {
    const defines = { LOOK: look };
    if (occlusion) defines.HAS_OCCLUSION = "";
    if (picture) defines.HAS_PICTURE = "";
    const uniforms = {
      occlusion: { value: occlusion },
      picture: { value: picture },
      color: { value: new THREE.Color(...color) },
      key: { value: new THREE.Vector3() },
      opacity: { value: settings.opacity ?? 1 },
    };
    const shaders = { vertexShader: VERTEX_SHADER, fragmentShader: FRAGMENT_SHADER };
    return new THREE.ShaderMaterial({ defines, uniforms, ...shaders, ...settings });
  }

  /** All spheres as instances of one, of more triangles where there are fewer; `packed`: `ViewGeometry.pack_spheres`. */
  function sphereMesh(packed) {
    const spheres = new Float32Array(AoView.bytesOf(packed).buffer), count = spheres.length / 4;
    const detail = Math.sqrt(MAX_SPHERE_TRIANGLES / 20 / Math.max(count, 1)) - 1;
    const geometry = new THREE.IcosahedronGeometry(1, Math.round(Math.min(Math.max(detail, 2), 14)));
    const mesh = new THREE.InstancedMesh(geometry, material(0, { color: SPHERE }), count);
    const matrix = new THREE.Matrix4();
    for (let i = 0; i < count; i++) {
      const [x, y, z, radius] = spheres.subarray(4 * i, 4 * i + 4);
      mesh.setMatrixAt(i, matrix.makeScale(radius, radius, radius).setPosition(x, y, z));
    }
    return mesh;
  }

  Object.assign(AoView, { CLAY, imageOf, textureOf, checkerImage, material, sphereMesh });
})();
