/** A live stream with Babylon.js: `show(canvas, "http://127.0.0.1:8080/v1/streams/demo")`. */
import * as BABYLON from "@babylonjs/core";
import { watch } from "steadymesh";

export function show(canvas, address, options = {}) {
  const scene = new BABYLON.Scene(new BABYLON.Engine(canvas, true));
  scene.useRightHandedSystem = true;
  const target = BABYLON.Vector3.Zero();
  const camera = new BABYLON.ArcRotateCamera("camera", Math.PI / 2, 1.5, 3, target, scene);
  const surface = new BABYLON.Mesh("surface", scene);
  const material = new BABYLON.StandardMaterial("material", scene);
  surface.material = material;
  material.sideOrientation = BABYLON.Material.CounterClockWiseSideOrientation;
  material.disableLighting = true;
  material.emissiveColor = BABYLON.Color3.White();
  let shown = null;
  const onFrame = ({ mesh, texture }) => {
    Object.assign(new BABYLON.VertexData(), mesh, { colors: null }).applyToMesh(surface, true);
    if (texture?.image && texture.image !== shown) {
      material.diffuseTexture?.dispose();
      material.diffuseTexture = new BABYLON.DynamicTexture("image", texture.image, scene);
      material.diffuseTexture.getContext().drawImage(texture.image, 0, 0);
      material.diffuseTexture.update(false); // Its rows come from the bottom up already.
    }
    shown = texture?.image ?? null;
    camera.zoomOn([surface]);
    scene.render();
  };
  return watch(address, { onFrame, ...options });
}
