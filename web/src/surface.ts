/** How the mesh looks: lit clay, its normals as colours, and its edges on top of either. */

import { DoubleSide, MeshStandardMaterial } from "three";

const VERTEX_DECLARATIONS = `
varying vec3 vCorner;
void main() {
  int corner = gl_VertexID % 3;
  vCorner = vec3(corner == 0, corner == 1, corner == 2);
`;

const FRAGMENT_DECLARATIONS = `
uniform float edges;
uniform float normalColors;
varying vec3 vCorner;
void main() {
`;

// In output colours, after tone mapping. Lines keep a constant width in pixels; where faces are
// smaller than a few pixels they fade, or a dense mesh would turn into a blot.
const FRAGMENT_OVERLAY = `
#include <dithering_fragment>
gl_FragColor.rgb = mix(gl_FragColor.rgb, normal * 0.5 + 0.5, normalColors);
vec3 perPixel = fwidth(vCorner);
vec3 away = smoothstep(perPixel * 0.1, perPixel * 0.85, vCorner);
float line = 1.0 - min(away.x, min(away.y, away.z));
line *= 1.0 - smoothstep(0.3, 0.9, max(perPixel.x, max(perPixel.y, perPixel.z)));
vec3 ink = mix(vec3(0.03, 0.14, 0.17), gl_FragColor.rgb * 0.3, normalColors);
gl_FragColor.rgb = mix(gl_FragColor.rgb, ink, line * edges * 0.75);
`;

/** Wants face corners in face order, as `expandCorners` writes them, not indexed vertices. */
export class SurfaceMaterial extends MeshStandardMaterial {
  private readonly overlay = { edges: { value: 0 }, normalColors: { value: 0 } };

  constructor() {
    super({ color: 0xd3d7de, roughness: 0.62, metalness: 0.04, side: DoubleSide });
    this.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, this.overlay);
      shader.vertexShader = shader.vertexShader.replace("void main() {", VERTEX_DECLARATIONS);
      shader.fragmentShader = shader.fragmentShader
        .replace("void main() {", FRAGMENT_DECLARATIONS)
        .replace("#include <dithering_fragment>", FRAGMENT_OVERLAY);
    };
  }

  set showsEdges(on: boolean) {
    this.overlay.edges.value = on ? 1 : 0;
  }

  set showsNormals(on: boolean) {
    this.overlay.normalColors.value = on ? 1 : 0;
  }
}
