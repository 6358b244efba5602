/** A deck, and what becomes of its frames: drawn in one half of the view, and plotted. */

import type { DecodedFrame, DecoderPool, FrameMetrics, LinkState } from "steadymesh";
import type { Deck, DeckEvents } from "./deck";
import { Presenter } from "./presenter";

export interface PlayerEvents {
  /** A frame is shown. */
  onShown(metrics: FrameMetrics): void;
  /** A frame came in, shown or not. */
  onReceived(metrics: FrameMetrics): void;
  /** All frames up to now. */
  onHeld(metrics: FrameMetrics[]): void;
  /** The line of frames is interrupted. */
  onBreak(): void;
}

/** Where frames are drawn; `refit` if they may be of another size than those before. */
export type Draw = (frame: DecodedFrame, change: Float32Array | null, refit: boolean) => void;

export class Player<D extends Deck = Deck> {
  readonly deck: D;
  private readonly presenter: Presenter;
  private refit = false;

  constructor(
    makeDeck: (events: DeckEvents) => D,
    pool: DecoderPool,
    draw: Draw,
    private readonly events: PlayerEvents,
  ) {
    this.deck = makeDeck({
      onFrame: (frame) => this.onFrame(frame),
      onReceived: (metrics) => events.onReceived(metrics),
      onHeld: (metrics) => events.onHeld(metrics),
      onBreak: () => events.onBreak(),
      onState: (state) => this.onState(state),
    });
    this.presenter = new Presenter(
      pool,
      (frame, change) => {
        draw(frame, change, this.refit);
        this.refit = false;
      },
      (frame) => this.deck.release(frame),
    );
  }

  set measuresChange(on: boolean) {
    this.presenter.measuresChange = on;
  }

  /** Frames that were decoded and not drawn. */
  get undrawn(): number {
    return this.presenter.skipped;
  }

  close(): void {
    this.presenter.close();
    this.deck.close();
  }

  private onFrame(frame: DecodedFrame): void {
    const { metrics } = frame;
    this.presenter.show(frame);
    this.events.onShown(metrics);
  }

  private onState(state: LinkState): void {
    if (state.kind === "absent") this.refit = true;
  }
}
