/**
 * The three.js scene: one mesh that is replaced by every frame, and a camera around it.
 *
 * The first frame's bounding box is carried to the origin and to a diagonal of 1, so everything
 * here is in diagonals and a mesh may be in any unit. Nothing is drawn unless something changed.
 */

import {
  BufferAttribute,
  BufferGeometry,
  DynamicDrawUsage,
  Mesh,
  NeutralToneMapping,
  PerspectiveCamera,
  Scene,
  Spherical,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { type Bounds, boundsOf, type DecodedMesh, expandCorners, vertexNormals } from "./geometry";
import { Stage } from "./stage";
import { SurfaceMaterial } from "./surface";

const FIELD_OF_VIEW_DEGREES = 32;
/** What lies over the canvas at its top and its bottom, in CSS pixels. */
const COVERED = { top: 58, bottom: 78 };
/** Seen from slightly above and from the side. */
const FIRST_DIRECTION = new Vector3(0.35, 0.16, 1).normalize();
/** Radians and distance factor for one press of a key. */
const KEY_TURN = Math.PI / 24;
const KEY_ZOOM = 1.1;
const MAX_PIXEL_RATIO = 2;

export class Viewer {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEGREES, 1, 0.005, 60);
  private readonly controls: OrbitControls;
  private readonly stage = new Stage();
  private readonly material = new SurfaceMaterial();
  private readonly mesh = new Mesh(new BufferGeometry(), this.material);
  /** Of the newest frame, in the mesh's unit. */
  private bounds: Bounds | null = null;
  /** Size of the fitted box in diagonals; `null` until there was a frame. */
  private fitted: Vector3 | null = null;
  private touched = false;
  private dirty = true;
  private lastTickMs = 0;

  /** @throws {Error} if the browser has no WebGL 2. */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly autoRotate: boolean,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.shadowMap.enabled = true;
    // The lights stand still: only a new mesh makes a new shadow.
    this.renderer.shadowMap.autoUpdate = false;
    this.mesh.castShadow = true;
    // Its bounding sphere would have to be computed for every frame.
    this.mesh.frustumCulled = false;
    this.mesh.visible = false;
    this.stage.visible = false;
    this.scene.add(this.stage, this.mesh);
    this.controls = this.createControls();
    this.placeCamera();
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener("keydown", this.onKey);
    canvas.addEventListener("webglcontextrestored", () => this.invalidate());
    this.renderer.setAnimationLoop((nowMs: number) => this.tick(nowMs));
  }

  /** Shows this mesh instead of the one before. */
  show(mesh: DecodedMesh): void {
    this.upload(mesh);
    this.bounds = boundsOf(mesh.positions);
    this.mesh.visible = mesh.indices.length > 0;
    if (this.fitted === null) this.resetView();
    this.invalidate();
  }

  /** Fits the camera to the newest frame and turns again, if it may. */
  resetView(): void {
    if (this.bounds !== null) this.fitTo(this.bounds);
    this.touched = false;
    this.controls.autoRotate = this.autoRotate;
    this.placeCamera();
  }

  setEdges(on: boolean): void {
    this.material.showsEdges = on;
    this.dirty = true;
  }

  setNormalColors(on: boolean): void {
    this.material.showsNormals = on;
    this.dirty = true;
  }

  private createControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.canvas);
    controls.enableDamping = true;
    controls.dampingFactor = 0.08;
    controls.minDistance = 0.05;
    controls.maxDistance = 12;
    controls.autoRotate = this.autoRotate;
    controls.autoRotateSpeed = 1.1;
    controls.addEventListener("start", () => this.takeOver());
    controls.addEventListener("change", () => {
      this.dirty = true;
    });
    return controls;
  }

  /** The camera belongs to the user from now on. */
  private takeOver(): void {
    this.touched = true;
    this.controls.autoRotate = false;
  }

  /** Buffers grow by half and are kept; a smaller mesh uses their beginning. */
  private upload(mesh: DecodedMesh): void {
    const corners = mesh.indices.length;
    let { geometry } = this.mesh;
    let position = geometry.getAttribute("position") as BufferAttribute | undefined;
    let normal = geometry.getAttribute("normal") as BufferAttribute | undefined;
    if (position === undefined || normal === undefined || position.count < corners) {
      geometry.dispose();
      geometry = new BufferGeometry();
      position = dynamicAttribute(Math.ceil(corners * 1.5));
      normal = dynamicAttribute(Math.ceil(corners * 1.5));
      geometry.setAttribute("position", position).setAttribute("normal", normal);
      this.mesh.geometry = geometry;
    }
    expandCorners(mesh.positions, mesh.indices, position.array as Float32Array);
    expandCorners(vertexNormals(mesh), mesh.indices, normal.array as Float32Array);
    for (const attribute of [position, normal]) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, corners * 3);
      attribute.needsUpdate = true;
    }
    geometry.setDrawRange(0, corners);
  }

  private fitTo({ min, max }: Bounds): void {
    const size = new Vector3(...max).sub(new Vector3(...min));
    const scale = 1 / (size.length() || 1);
    const center = new Vector3(...min).addScaledVector(size, 0.5);
    this.mesh.scale.setScalar(scale);
    this.mesh.position.copy(center).multiplyScalar(-scale);
    this.fitted = size.multiplyScalar(scale);
    this.stage.placeFloor(-this.fitted.y / 2);
    this.stage.visible = true;
    this.invalidate();
  }

  /** Far enough away for the fitted box from every side, as it turns. */
  private placeCamera(): void {
    const { x, y, z } = this.fitted ?? new Vector3(0.5, 0.8, 0.3);
    const width = Math.hypot(x, z);
    const tangent = Math.tan((FIELD_OF_VIEW_DEGREES / 2) * (Math.PI / 180));
    const visible = y / freeShare(this.canvas.clientHeight);
    const distance = Math.max(visible, width / this.camera.aspect) / (2 * tangent) + width / 2;
    this.camera.position.copy(FIRST_DIRECTION).multiplyScalar(distance);
    this.controls.target.set(0, 0, 0);
    this.controls.update();
    this.dirty = true;
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_PIXEL_RATIO));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // The middle of the scene goes to the middle of the free part.
    const shift = (COVERED.bottom - COVERED.top) / 2;
    this.camera.setViewOffset(width, height, 0, shift, width, height);
    if (!this.touched && this.fitted === null) this.placeCamera();
    else if (!this.touched) this.keepAngle();
    // A resized canvas is empty: draw at once rather than flash.
    this.renderer.render(this.scene, this.camera);
  }

  /** Fits again after a change of shape without losing the angle of the rotation. */
  private keepAngle(): void {
    const direction = this.camera.position.clone().normalize();
    this.placeCamera();
    this.camera.position.copy(direction.multiplyScalar(this.camera.position.length()));
    this.controls.update();
  }

  private readonly onKey = (event: KeyboardEvent): void => {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const angles = new Spherical().setFromVector3(offset);
    if (event.key === "ArrowLeft") angles.theta -= KEY_TURN;
    else if (event.key === "ArrowRight") angles.theta += KEY_TURN;
    else if (event.key === "ArrowUp") angles.phi -= KEY_TURN;
    else if (event.key === "ArrowDown") angles.phi += KEY_TURN;
    else if (event.key === "+" || event.key === "=") angles.radius /= KEY_ZOOM;
    else if (event.key === "-") angles.radius *= KEY_ZOOM;
    else return;
    event.preventDefault();
    this.takeOver();
    this.camera.position.setFromSpherical(angles.makeSafe()).add(this.controls.target);
    this.controls.update();
    this.dirty = true;
  };

  /** Draws again, with new shadows. */
  private invalidate(): void {
    this.renderer.shadowMap.needsUpdate = true;
    this.dirty = true;
  }

  private tick(nowMs: number): void {
    // Long gaps (a hidden page) must not turn into a jump.
    const seconds = Math.min((nowMs - this.lastTickMs) / 1000, 0.1);
    this.lastTickMs = nowMs;
    this.controls.update(seconds);
    if (!this.dirty) return;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
  }
}

/** The share of the canvas's height that nothing covers. */
function freeShare(height: number): number {
  return Math.max(0.4, 1 - (COVERED.top + COVERED.bottom) / Math.max(height, 1));
}

function dynamicAttribute(corners: number): BufferAttribute {
  return new BufferAttribute(new Float32Array(corners * 3), 3).setUsage(DynamicDrawUsage);
}
