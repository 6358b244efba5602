/**
 * The canvas: one camera around one stream, or around two side by side. Nothing is drawn unless
 * something changed.
 */

import type { DecodedFrame } from "steadymesh";
import { NeutralToneMapping, PerspectiveCamera, Spherical, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { ViewMode } from "./modes";
import { Pane } from "./pane";

const FIELD_OF_VIEW_DEGREES = 32;
/** Seen from slightly above and from the side. */
const FIRST_DIRECTION = new Vector3(0.35, 0.16, 1).normalize();
/** Radians and distance factor for one press of a key. */
const KEY_TURN = Math.PI / 24;
const KEY_ZOOM = 1.1;
const MAX_PIXEL_RATIO = 2;

/** What is on the graphics card, for who looks for leaks. */
export interface GraphicsMemory {
  geometries: number;
  textures: number;
}

export class Viewer {
  private readonly renderer: WebGLRenderer;
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEGREES, 1, 0.005, 60);
  private readonly controls: OrbitControls;
  private readonly panes: Pane[] = [];
  private mode: ViewMode = "color";
  private edges = false;
  private touched = false;
  private dirty = true;
  private lastTickMs = 0;

  /**
   * `covered` is what lies over the canvas at its top and its bottom, in CSS pixels; `beforeDraw` is
   * called once for each refresh of the screen.
   *
   * @throws {Error} if the browser has no WebGL 2.
   */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly options: {
      autoRotate: boolean;
      covered(): { top: number; bottom: number };
      beforeDraw(nowMs: number): void;
    },
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.shadowMap.enabled = true;
    // The lights stand still: only a new mesh makes a new shadow.
    this.renderer.shadowMap.autoUpdate = false;
    this.renderer.setScissorTest(true);
    this.controls = this.createControls();
    this.setPanes(1);
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener("keydown", this.onKey);
    canvas.addEventListener("dblclick", () => this.resetView());
    canvas.addEventListener("webglcontextrestored", () => this.invalidate());
    this.renderer.setAnimationLoop((nowMs: number) => this.tick(nowMs));
  }

  /** So many streams side by side. */
  setPanes(count: 1 | 2): void {
    while (this.panes.length > count) this.panes.pop()?.dispose();
    while (this.panes.length < count) {
      const pane = new Pane(this.renderer);
      pane.setMode(this.mode);
      pane.setEdges(this.edges);
      this.panes.push(pane);
    }
    this.resize();
  }

  /** Shows a frame in the pane of this number. */
  show(index: number, frame: DecodedFrame, change: Float32Array | null): void {
    const pane = this.panes[index];
    if (pane === undefined) return;
    pane.show(frame, change);
    if (pane.fitted === null) {
      pane.fit(this.panes.find((other) => other !== pane) ?? null);
      if (!this.touched) this.placeCamera();
    }
    this.dirty = true;
  }

  /** Fits the camera to the newest frames and turns again, if it may. */
  resetView(): void {
    this.panes.forEach((pane, index) => {
      pane.fit(index === 0 ? null : (this.panes[0] ?? null));
    });
    this.touched = false;
    this.controls.autoRotate = this.options.autoRotate;
    // What is left of a swing would carry the camera on.
    this.controls.enableDamping = false;
    this.controls.update();
    this.controls.enableDamping = true;
    this.placeCamera();
  }

  setMode(mode: ViewMode): void {
    this.mode = mode;
    for (const pane of this.panes) pane.setMode(mode);
    this.dirty = true;
  }

  setEdges(on: boolean): void {
    this.edges = on;
    for (const pane of this.panes) pane.setEdges(on);
    this.dirty = true;
  }

  get memory(): GraphicsMemory {
    const { geometries, textures } = this.renderer.info.memory;
    return { geometries, textures };
  }

  private createControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.canvas);
    controls.enableDamping = true;
    controls.dampingFactor = 0.08;
    controls.minDistance = 0.05;
    controls.maxDistance = 12;
    controls.autoRotate = this.options.autoRotate;
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

  /** Far enough away for the fitted boxes from every side, as it turns. */
  private placeCamera(): void {
    const sizes = this.panes.flatMap(({ fitted }) => fitted ?? []);
    const largest = new Vector3();
    for (const size of sizes) largest.max(size);
    const { x, y, z } = sizes.length > 0 ? largest : new Vector3(0.5, 0.8, 0.3);
    const width = Math.hypot(x, z);
    const tangent = Math.tan((FIELD_OF_VIEW_DEGREES / 2) * (Math.PI / 180));
    const { top, bottom } = this.options.covered();
    const free = Math.max(0.4, 1 - (top + bottom) / Math.max(this.canvas.clientHeight, 1));
    const distance = Math.max(y / free, width / this.camera.aspect) / (2 * tangent) + width / 2;
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
    const paneWidth = width / this.panes.length;
    this.camera.aspect = paneWidth / height;
    // The middle of the scene goes to the middle of the free part.
    const { top, bottom } = this.options.covered();
    this.camera.setViewOffset(paneWidth, height, 0, (bottom - top) / 2, paneWidth, height);
    if (!this.touched) this.keepAngle();
    // A resized canvas is empty: draw at once rather than flash.
    this.draw();
  }

  /** Fits again after a change of shape without losing the angle of the rotation. */
  private keepAngle(): void {
    const direction = this.camera.position.clone().normalize();
    this.placeCamera();
    if (direction.lengthSq() === 0) return;
    this.camera.position.copy(direction.multiplyScalar(this.camera.position.length()));
    this.controls.update();
  }

  private readonly onKey = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
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
    event.stopPropagation();
    this.takeOver();
    this.camera.position.setFromSpherical(angles.makeSafe()).add(this.controls.target);
    this.controls.update();
    this.dirty = true;
  };

  /** Draws again, with new shadows. */
  private invalidate(): void {
    for (const pane of this.panes) pane.shadowIsOld = true;
    this.dirty = true;
  }

  private tick(nowMs: number): void {
    // Long gaps (a hidden page) must not turn into a jump.
    const seconds = Math.min((nowMs - this.lastTickMs) / 1000, 0.1);
    this.lastTickMs = nowMs;
    const start = performance.now();
    this.options.beforeDraw(nowMs);
    this.controls.update(seconds);
    if (!this.dirty) return;
    this.draw();
    // For who looks at the page's speed; the browser keeps none of them.
    performance.measure("steadymesh-frame", { start });
    performance.clearMeasures("steadymesh-frame");
  }

  private draw(): void {
    this.dirty = false;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const paneWidth = width / this.panes.length;
    this.panes.forEach((pane, index) => {
      this.renderer.setViewport(index * paneWidth, 0, paneWidth, height);
      this.renderer.setScissor(index * paneWidth, 0, paneWidth, height);
      this.renderer.shadowMap.needsUpdate = pane.shadowIsOld;
      pane.shadowIsOld = false;
      this.renderer.render(pane.scene, this.camera);
    });
  }
}
