/** A small plot over the last frames: some figures in percent, of one stream or of two. */

export interface PlotSample<Series extends string> {
  seq: number | null;
  /** Percent; `null` where there is nothing to compare with. */
  values: Record<Series, number | null>;
  /** The frame has nothing to do with the one before: a dashed line stands there. */
  reset: boolean;
}

export const PLOT_FRAMES = 150;

const MARGIN = { left: 54, right: 6, top: 8, bottom: 18 };
const TICK_COUNT = 3;

/** The smallest of 1, 2, 2.5 and 5 times a power of ten that is not below `value`. */
export function niceCeiling(value: number): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  const step = [1, 2, 2.5, 5, 10].find((candidate) => value <= candidate * power * (1 + 1e-9));
  return (step ?? 10) * power;
}

/** Heights of the horizontal lines: from 0 up to at least `highest`. */
export function ticksUpTo(highest: number): number[] {
  const step = niceCeiling(highest / TICK_COUNT);
  const steps = Math.max(1, Math.ceil(highest / step - 1e-9));
  return Array.from({ length: steps + 1 }, (_, i) => Number((i * step).toPrecision(12)));
}

/**
 * Each series has the colour of the style sheet's variable of its name. A second stream's lines are
 * dotted, in the same colours.
 */
export class Plot<Series extends string> {
  private lanes: [PlotSample<Series>[], PlotSample<Series>[]] = [[], []];
  private scheduled = false;
  private readonly lines: { series: Series; color: string }[];
  private readonly grid: string;
  private readonly text: string;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    series: readonly Series[],
  ) {
    const style = getComputedStyle(document.documentElement);
    const color = (name: string) => style.getPropertyValue(`--${name}`).trim();
    this.lines = series.map((name) => ({ series: name, color: color(name) }));
    this.grid = color("line");
    this.text = color("muted");
    new ResizeObserver(() => this.schedule()).observe(canvas);
  }

  /** A frame of the first stream, or of the second. */
  add(lane: 0 | 1, sample: PlotSample<Series>): void {
    this.lanes[lane].push(sample);
    if (this.lanes[lane].length > PLOT_FRAMES) this.lanes[lane].shift();
    this.schedule();
  }

  clear(lane: 0 | 1): void {
    this.lanes[lane] = [];
    this.schedule();
  }

  /** At most one drawing per screen refresh. */
  private schedule(): void {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.draw();
    });
  }

  private draw(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const context = this.canvas.getContext("2d");
    if (context === null || width === 0) return;
    const ratio = window.devicePixelRatio;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    context.scale(ratio, ratio);
    const values = this.lanes
      .flat()
      .flatMap((sample) =>
        this.lines.map(({ series }) => sample.values[series]).filter((value) => value !== null),
      );
    const ticks = ticksUpTo(Math.max(0, ...values));
    const area = {
      left: MARGIN.left,
      right: width - MARGIN.right,
      top: MARGIN.top,
      bottom: height - MARGIN.bottom,
    };
    const yOf = (value: number) =>
      area.bottom - (value / (ticks.at(-1) ?? 1)) * (area.bottom - area.top);
    this.drawAxes(context, area, ticks, yOf);
    // The newest frame is at the right edge from the first one on.
    const step = (area.right - area.left) / (PLOT_FRAMES - 1);
    this.lanes.forEach((samples, lane) => {
      const xOf = (index: number) => area.right - (samples.length - 1 - index) * step;
      if (lane === 0) this.drawResets(context, area, xOf);
      context.setLineDash(lane === 0 ? [] : [2, 3]);
      for (const line of this.lines) this.drawLine(context, samples, line, xOf, yOf);
    });
    context.setLineDash([]);
  }

  private drawAxes(
    context: CanvasRenderingContext2D,
    area: { left: number; right: number; bottom: number },
    ticks: number[],
    yOf: (value: number) => number,
  ): void {
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = this.text;
    context.strokeStyle = this.grid;
    context.lineWidth = 1;
    context.textBaseline = "middle";
    context.textAlign = "right";
    for (const tick of ticks) {
      const y = Math.round(yOf(tick)) + 0.5;
      context.beginPath();
      context.moveTo(area.left, y);
      context.lineTo(area.right, y);
      context.stroke();
      context.fillText(`${Number(tick.toPrecision(3))} %`, area.left - 6, y);
    }
    const seq = this.lanes[0].at(-1)?.seq ?? null;
    context.textBaseline = "alphabetic";
    context.fillText(seq === null ? "now" : `frame ${seq}`, area.right, area.bottom + 14);
    context.textAlign = "left";
    context.fillText(`−${PLOT_FRAMES} frames`, area.left, area.bottom + 14);
  }

  private drawResets(
    context: CanvasRenderingContext2D,
    area: { left: number; top: number; bottom: number },
    xOf: (index: number) => number,
  ): void {
    context.strokeStyle = this.text;
    context.lineWidth = 1;
    context.setLineDash([3, 3]);
    this.lanes[0].forEach((sample, index) => {
      if (!sample.reset) return;
      const x = Math.round(xOf(index)) + 0.5;
      context.beginPath();
      context.moveTo(x, area.top);
      context.lineTo(x, area.bottom);
      context.stroke();
    });
    context.setLineDash([]);
  }

  /** One line, interrupted where a frame has no value. */
  private drawLine(
    context: CanvasRenderingContext2D,
    samples: PlotSample<Series>[],
    { series, color }: { series: Series; color: string },
    xOf: (index: number) => number,
    yOf: (value: number) => number,
  ): void {
    context.beginPath();
    let last: { x: number; y: number } | null = null;
    samples.forEach((sample, index) => {
      const value = sample.values[series];
      if (value === null) {
        last = null;
        return;
      }
      const point = { x: xOf(index), y: yOf(value) };
      if (last === null) context.moveTo(point.x, point.y);
      else context.lineTo(point.x, point.y);
      last = point;
    });
    context.strokeStyle = context.fillStyle = color;
    context.lineWidth = 1.75;
    context.lineJoin = "round";
    context.stroke();
    if (last === null) return;
    const { x, y }: { x: number; y: number } = last;
    context.beginPath();
    context.arc(x, y, 2.5, 0, 2 * Math.PI);
    context.fill();
  }
}
