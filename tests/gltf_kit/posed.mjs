// What three.js makes of animated meshes: `node posed.mjs THREE FILE [CLIP SECONDS]...` prints a JSON list with, for each pose,
// the positions of all corners of all triangles, in world space. THREE is the folder of three.js.

import { readFile } from "node:fs/promises";

globalThis.self = globalThis; // as in browsers, which the loader expects
const [three, file, ...poses] = process.argv.slice(2);
const { AnimationMixer, LoopOnce, Vector3 } = await import(`${three}/build/three.module.js`);
const { GLTFLoader } = await import(`${three}/examples/jsm/loaders/GLTFLoader.js`);

const found = [];
for (let pose = 0; pose < poses.length; pose += 2) {
  const data = new Uint8Array(await readFile(file));
  const { scene, animations } = await new GLTFLoader().parseAsync(data.buffer, "");
  const mixer = new AnimationMixer(scene);
  const action = mixer.clipAction(animations.find((clip) => clip.name === poses[pose]));
  action.setLoop(LoopOnce);
  action.clampWhenFinished = true;
  action.play();
  mixer.setTime(Number(poses[pose + 1]));
  scene.updateMatrixWorld(true);
  const corners = [];
  scene.traverse((mesh) => {
    if (!mesh.isMesh) return;
    const { index, attributes } = mesh.geometry;
    for (let corner = 0; corner < (index ?? attributes.position).count; corner++) {
      const position = mesh.getVertexPosition(index ? index.getX(corner) : corner, new Vector3());
      corners.push(position.applyMatrix4(mesh.matrixWorld).toArray());
    }
  });
  found.push(corners);
}
console.log(JSON.stringify(found));
