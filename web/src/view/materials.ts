/** How the mesh looks: lit clay, or colours as they are; and its edges on top of either. */

import { DoubleSide, MeshStandardMaterial, ShaderMaterial, type Texture } from "three";
import { CHANGE_RAMP } from "./modes";

/** What the colours are of; the numbers are the shader's. */
export const FLAT = { plain: 0, texture: 1, vertices: 2, normals: 3, change: 4 } as const;

// Lines keep a constant width in pixels; where faces are smaller than a few pixels they fade, or a
// dense mesh would turn into a blot.
const LINE = `
float edgeLine(vec3 corner) {
  vec3 perPixel = fwidth(corner);
  vec3 away = smoothstep(perPixel * 0.1, perPixel * 0.85, corner);
  float line = 1.0 - min(away.x, min(away.y, away.z));
  return line * (1.0 - smoothstep(0.3, 0.9, max(perPixel.x, max(perPixel.y, perPixel.z))));
}
`;

const CORNER = `
  int corner = gl_VertexID % 3;
  vCorner = vec3(corner == 0, corner == 1, corner == 2);
`;

/**
 * Clay under the stage's lights. Wants face corners in face order, as `expandCorners` writes them.
 */
export class ClayMaterial extends MeshStandardMaterial {
  private readonly overlay = { edges: { value: 0 } };

  constructor() {
    super({ color: 0xd3d7de, roughness: 0.62, metalness: 0.04, side: DoubleSide });
    this.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, this.overlay);
      shader.vertexShader = shader.vertexShader.replace(
        "void main() {",
        `varying vec3 vCorner;\nvoid main() {${CORNER}`,
      );
      // In output colours, after tone mapping.
      shader.fragmentShader = shader.fragmentShader
        .replace(
          "void main() {",
          `uniform float edges;\nvarying vec3 vCorner;\n${LINE}\nvoid main() {`,
        )
        .replace(
          "#include <dithering_fragment>",
          `#include <dithering_fragment>
          float ink = edgeLine(vCorner) * edges * 0.75;
          gl_FragColor.rgb = mix(gl_FragColor.rgb, vec3(0.03, 0.14, 0.17), ink);`,
        );
    };
  }

  set showsEdges(on: boolean) {
    this.overlay.edges.value = on ? 1 : 0;
  }
}

const RAMP = CHANGE_RAMP.map((rgb) => `vec3(${rgb.map((v) => (v / 255).toFixed(4)).join(", ")})`);

const FLAT_VERTEX = `
attribute vec4 tint;
attribute float change;
varying vec3 vCorner;
varying vec3 vNormal;
varying vec2 vPlace;
varying vec4 vTint;
varying float vChange;
void main() {${CORNER}
  vNormal = normalMatrix * normal;
  vPlace = uv;
  vTint = tint;
  vChange = change;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const FLAT_FRAGMENT = `
uniform int kind;
uniform float edges;
uniform sampler2D image;
varying vec3 vCorner;
varying vec3 vNormal;
varying vec2 vPlace;
varying vec4 vTint;
varying float vChange;
${LINE}
vec3 ramp(float at) {
  vec3 colors[${RAMP.length}] = vec3[](${RAMP.join(", ")});
  float scaled = clamp(at, 0.0, 1.0) * ${(RAMP.length - 1).toFixed(1)};
  int low = min(int(scaled), ${RAMP.length - 2});
  return mix(colors[low], colors[low + 1], scaled - float(low));
}
void main() {
  vec3 normal = normalize(vNormal) * (gl_FrontFacing ? 1.0 : -1.0);
  // A little form where colours have none of their own.
  float form = 0.72 + 0.28 * max(normal.z, 0.0);
  // Outside of any condition: the right level of the image comes from neighbouring pixels.
  vec3 texel = linearToOutputTexel(texture2D(image, vPlace)).rgb;
  vec3 color = vec3(0.75) * form;
  if (kind == ${FLAT.texture}) color = texel;
  else if (kind == ${FLAT.vertices}) color = vTint.rgb;
  else if (kind == ${FLAT.normals}) color = normal * 0.5 + 0.5;
  else if (kind == ${FLAT.change}) color = ramp(vChange) * form;
  float line = edgeLine(vCorner) * edges * 0.75;
  gl_FragColor = vec4(mix(color, color * 0.25, line), 1.0);
}`;

/** Colours without light: of the image, the vertices, the normals, or the change. */
export class FlatMaterial extends ShaderMaterial {
  constructor() {
    super({
      uniforms: { kind: { value: FLAT.plain }, edges: { value: 0 }, image: { value: null } },
      vertexShader: FLAT_VERTEX,
      fragmentShader: FLAT_FRAGMENT,
      side: DoubleSide,
      toneMapped: false,
    });
  }

  set showsEdges(on: boolean) {
    this.set("edges", on ? 1 : 0);
  }

  set kind(kind: number) {
    this.set("kind", kind);
  }

  set image(texture: Texture | null) {
    this.set("image", texture);
  }

  private set(name: string, value: unknown): void {
    const uniform = this.uniforms[name];
    if (uniform !== undefined) uniform.value = value;
  }
}
