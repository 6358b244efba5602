/** Light and floor around the mesh, in units of the mesh's bounding-box diagonal. */

import {
  CircleGeometry,
  Color,
  DirectionalLight,
  Group,
  HemisphereLight,
  Mesh,
  ShaderMaterial,
  ShadowMaterial,
} from "three";

const FLOOR_RADIUS = 1.6;

/** Half the side of the box around the origin that casts a shadow. */
const SHADOW_REACH = 0.85;

export class Stage extends Group {
  private readonly floor = new Group();
  private readonly key = keyLight();
  private readonly disc = new CircleGeometry(FLOOR_RADIUS, 64).rotateX(-Math.PI / 2);
  private readonly grid = gridMaterial();
  private readonly shade = new ShadowMaterial({ opacity: 0.55 });

  constructor() {
    super();
    const rim = new DirectionalLight(0x8fd8ff, 1.5);
    rim.position.set(-1.2, 0.7, -1.4);
    const fill = new DirectionalLight(0xa9c4ff, 0.55);
    fill.position.set(-1.6, 0.3, 1.2);
    this.add(new HemisphereLight(0xcfe0ff, 0x2b2622, 0.85), this.key, rim, fill, this.floor);
    const shadow = new Mesh(this.disc, this.shade);
    shadow.receiveShadow = true;
    shadow.renderOrder = 1;
    this.floor.add(new Mesh(this.disc, this.grid), shadow);
  }

  free(): void {
    this.key.dispose();
    this.disc.dispose();
    this.grid.dispose();
    this.shade.dispose();
  }

  /** Puts the floor at this height, just below the mesh so that the two do not flicker. */
  placeFloor(height: number): void {
    this.floor.position.y = height - 0.002;
  }
}

function keyLight(): DirectionalLight {
  const light = new DirectionalLight(0xfff0dd, 2.5);
  light.position.set(0.85, 2.1, 1.05);
  light.castShadow = true;
  light.shadow.mapSize.set(1024, 1024);
  light.shadow.radius = 5;
  light.shadow.bias = -0.0004;
  light.shadow.normalBias = 0.006;
  const { camera } = light.shadow;
  camera.left = camera.bottom = -SHADOW_REACH;
  camera.right = camera.top = SHADOW_REACH;
  camera.near = 0.5;
  camera.far = 4.5;
  return light;
}

/** Squares and rings that fade out before the floor ends. */
function gridMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    transparent: true,
    depthWrite: false,
    uniforms: { ink: { value: new Color(0x5eead4) } },
    vertexShader: `
      varying vec2 place;
      void main() {
        place = position.xz;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }`,
    fragmentShader: `
      uniform vec3 ink;
      varying vec2 place;
      float lines(vec2 at, float width) {
        vec2 pixel = fwidth(at);
        vec2 away = abs(fract(at - 0.5) - 0.5) / pixel;
        float line = 1.0 - min(min(away.x, away.y) / width, 1.0);
        return line * (1.0 - smoothstep(0.2, 0.6, max(pixel.x, pixel.y)));
      }
      void main() {
        float fade = 1.0 - smoothstep(0.15, 1.0, length(place) / ${FLOOR_RADIUS.toFixed(2)});
        float line = 0.28 * lines(place * 10.0, 1.1) + 0.4 * lines(place * 2.0, 1.2);
        gl_FragColor = vec4(ink, (line * 0.8 + 0.05) * fade * fade);
      }`,
  });
}
