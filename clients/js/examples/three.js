/** A live stream with three.js: `show(canvas, "http://127.0.0.1:8080/v1/streams/demo")`. */
import { watch } from "steadymesh";
import * as THREE from "three";

export function show(canvas, address, options = {}) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
  const camera = new THREE.PerspectiveCamera(40, canvas.width / canvas.height, 0.001, 1000);
  const surface = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial());
  const scene = new THREE.Scene().add(surface);
  const onFrame = ({ mesh, texture }) => {
    surface.geometry.dispose();
    surface.geometry = new THREE.BufferGeometry();
    surface.geometry.setIndex(new THREE.BufferAttribute(mesh.indices, 1));
    surface.geometry.setAttribute("position", new THREE.BufferAttribute(mesh.positions, 3));
    if (mesh.uvs) surface.geometry.setAttribute("uv", new THREE.BufferAttribute(mesh.uvs, 2));
    const { material } = surface;
    if (texture?.image && material.map?.image !== texture.image) {
      material.map?.dispose();
      material.map = new THREE.Texture(texture.image);
      material.map.colorSpace = THREE.SRGBColorSpace;
      material.map.flipY = false; // Its rows come from the bottom up already.
      material.map.needsUpdate = material.needsUpdate = true;
    }
    surface.geometry.computeBoundingSphere();
    const { center, radius } = surface.geometry.boundingSphere;
    camera.position.set(center.x, center.y, center.z + radius * 3);
    renderer.render(scene, camera);
  };
  return watch(address, { onFrame, ...options });
}
