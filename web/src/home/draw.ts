/** One frame as a picture. */

import { DecoderPool, FrameDecoder, type Place, TextureStore } from "steadymesh";
import { NeutralToneMapping, PerspectiveCamera, Vector3, WebGLRenderer } from "three";
import { server } from "../base/access";
import { Pane } from "../view/pane";

const FIELD_OF_VIEW_DEGREES = 26;
const DIRECTION = new Vector3(0.42, 0.14, 1).normalize();

const pool = new DecoderPool({ workers: 1 });
const textures = new TextureStore({ keep: 0 });
let renderer: WebGLRenderer | null = null;

/** Whether it could be drawn: not without WebGL 2, and not if the frame is gone. */
export async function draw(
  { place, seq }: { place: Place; seq: number },
  canvas: HTMLCanvasElement,
): Promise<boolean> {
  const decoder = new FrameDecoder(server, place, pool, textures);
  const frame = await decoder.fetch(seq);
  renderer ??= createRenderer();
  renderer.setSize(canvas.width, canvas.height, false);
  const pane = new Pane(renderer);
  try {
    pane.show(frame, null);
    pane.fit(null);
    renderer.render(pane.scene, cameraFor(pane, canvas.width / canvas.height));
    const context = canvas.getContext("2d");
    context?.clearRect(0, 0, canvas.width, canvas.height);
    context?.drawImage(renderer.domElement, 0, 0);
    return context !== null;
  } finally {
    pane.dispose();
    decoder.release(frame);
  }
}

function createRenderer(): WebGLRenderer {
  // Read back right after it is drawn.
  const made = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
  made.toneMapping = NeutralToneMapping;
  made.shadowMap.enabled = true;
  return made;
}

function cameraFor({ fitted }: Pane, aspect: number): PerspectiveCamera {
  const camera = new PerspectiveCamera(FIELD_OF_VIEW_DEGREES, aspect, 0.01, 20);
  const { x, y, z } = fitted ?? new Vector3(0.6, 0.6, 0.6);
  const width = Math.hypot(x, z);
  const tangent = Math.tan((FIELD_OF_VIEW_DEGREES / 2) * (Math.PI / 180));
  const distance = (Math.max(y, width / aspect) * 1.12) / (2 * tangent) + width / 2;
  camera.position.copy(DIRECTION).multiplyScalar(distance);
  camera.lookAt(0, 0, 0);
  return camera;
}
