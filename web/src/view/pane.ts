/**
 * One stream's scene: a mesh that is replaced by every frame, on a stage.
 *
 * The first frame's bounding box is carried to the origin and to a diagonal of 1, so everything
 * is in diagonals and a mesh may be in any unit.
 */

import type { DecodedFrame } from "steadymesh";
import {
  type BufferGeometry,
  type Material,
  Mesh,
  Scene,
  Vector3,
  type WebGLRenderer,
} from "three";
import { CornerBuffers, type CornerValues } from "./corners";
import { areAlike, type Bounds, boundsOf, diagonalOf } from "./geometry";
import { ImageSlot } from "./image";
import { ClayMaterial, FLAT, FlatMaterial } from "./materials";
import { CHANGE_REACH, type ViewMode } from "./modes";
import { Stage } from "./stage";

export class Pane {
  readonly scene = new Scene();
  /** The stage's shadow is not of the mesh that is shown. */
  shadowIsOld = true;
  /** Size of the fitted box in diagonals; `null` until there was a frame. */
  fitted: Vector3 | null = null;
  /** Of the newest frame, in the mesh's unit. */
  bounds: Bounds | null = null;
  /** What was fitted, in the mesh's unit. */
  fittedBounds: Bounds | null = null;

  private readonly stage = new Stage();
  private readonly clay = new ClayMaterial();
  private readonly flat = new FlatMaterial();
  private readonly buffers = new CornerBuffers();
  private readonly image: ImageSlot;
  private readonly mesh: Mesh<BufferGeometry, Material> = new Mesh(
    this.buffers.geometry,
    this.clay,
  );
  private frame: DecodedFrame | null = null;
  private change: Float32Array | null = null;
  private mode: ViewMode = "color";

  constructor(renderer: WebGLRenderer) {
    this.image = new ImageSlot(renderer);
    this.mesh.castShadow = true;
    this.mesh.frustumCulled = false;
    this.mesh.visible = this.stage.visible = false;
    this.scene.add(this.stage, this.mesh);
  }

  /** Shows this frame; `change` is the distance of each point to what was shown before it. */
  show(frame: DecodedFrame, change: Float32Array | null): void {
    this.frame = frame;
    this.change = change;
    this.bounds = boundsOf(frame.mesh.positions);
    this.mesh.visible = frame.mesh.indices.length > 0;
    this.refresh();
  }

  setMode(mode: ViewMode): void {
    this.mode = mode;
    this.refresh();
  }

  setEdges(on: boolean): void {
    this.clay.showsEdges = on;
    this.flat.showsEdges = on;
  }

  /**
   * Fits the newest frame, or what `like` has fitted if that is of the same thing: two streams of
   * one capture then stand alike.
   */
  fit(like: Pane | null): void {
    if (this.bounds === null) return;
    const other = like?.fittedBounds ?? null;
    const bounds = other !== null && areAlike(other, this.bounds) ? other : this.bounds;
    const { min, max } = bounds;
    const size = new Vector3(...max).sub(new Vector3(...min));
    const scale = 1 / (diagonalOf(bounds) || 1);
    const center = new Vector3(...min).addScaledVector(size, 0.5);
    this.mesh.scale.setScalar(scale);
    this.mesh.position.copy(center).multiplyScalar(-scale);
    this.fitted = size.multiplyScalar(scale);
    this.fittedBounds = bounds;
    this.stage.placeFloor(-this.fitted.y / 2);
    this.stage.visible = true;
    this.shadowIsOld = true;
  }

  dispose(): void {
    this.buffers.dispose();
    this.image.clear();
    this.clay.dispose();
    this.flat.dispose();
    this.stage.free();
  }

  /** Fills the buffers that the mode needs, and chooses the material. */
  private refresh(): void {
    if (this.frame === null) return;
    const { mesh, texture } = this.frame;
    const textured = this.mode === "color" && mesh.uvs !== null && this.image.show(texture);
    const tinted = this.mode === "color" && !textured && mesh.colors !== null;
    const lit = this.mode === "shaded" || (this.mode === "color" && !textured && !tinted);
    const values: CornerValues = {
      positions: mesh.positions,
      normals: textured || tinted ? null : mesh.normals,
      uvs: textured ? mesh.uvs : null,
      colors: tinted ? mesh.colors : null,
      change: this.mode === "change" ? this.changeValues() : null,
    };
    this.buffers.fill(values, mesh.indices);
    this.mesh.geometry = this.buffers.geometry;
    this.mesh.material = lit ? this.clay : this.flat;
    this.flat.image = textured ? this.image.texture : null;
    this.flat.kind = textured
      ? FLAT.texture
      : tinted
        ? FLAT.vertices
        : this.mode === "normals"
          ? FLAT.normals
          : FLAT.change;
    this.shadowIsOld = true;
  }

  /** As shares of the scale; nothing has changed where nothing was before. */
  private changeValues(): Float32Array {
    const points = (this.frame?.mesh.positions.length ?? 0) / 3;
    const shares = new Float32Array(points);
    const diagonal = this.bounds === null ? 0 : diagonalOf(this.bounds);
    if (this.change === null || diagonal === 0) return shares;
    const scale = 1 / (diagonal * CHANGE_REACH);
    for (let i = 0; i < points; i += 1) shares[i] = (this.change[i] ?? 0) * scale;
    return shares;
  }
}
