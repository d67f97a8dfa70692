// Marks on frames: what was painted, as rectangles, and the annotations.json made of them. No pixels, no page: only
// numbers.

/** A round brush on a grid as fine as a quarter of it: a stroke becomes few rectangles and stays inside its edge. */
export function strokeRectangles(path, diameter, { width, height }) {
  const grid = Math.max(1, Math.floor(diameter / 4));
  const cells = new Map(); // row → set of columns
  const reach = diameter / 2;
  for (const [x, y] of densePath(path, grid)) {
    const last = Math.floor((y + reach) / grid);
    for (let row = Math.floor((y - reach) / grid); row <= last; row++) {
      const up = (row + 0.5) * grid - y;
      const half = Math.sqrt(Math.max(0, reach * reach - up * up));
      const [from, to] = [Math.ceil((x - half) / grid - 0.5), Math.floor((x + half) / grid - 0.5)];
      if (!cells.has(row)) cells.set(row, new Set());
      for (let column = from; column <= to; column++) cells.get(row).add(column);
    }
  }
  const runs = [...cells].sort(([a], [b]) => a - b).flatMap(([row, columns]) => runsOf(row, columns));
  return mergeRuns(runs)
    .map(run => clip({ x: run.from * grid, y: run.row * grid, w: run.length * grid, h: run.rows * grid }, width, height))
    .filter(Boolean);
}

/** The path with a point at least every `step` pixels. */
function densePath(path, step) {
  const points = [path[0]];
  for (const [x, y] of path.slice(1)) {
    const [fromX, fromY] = points[points.length - 1];
    const steps = Math.max(1, Math.ceil(Math.hypot(x - fromX, y - fromY) / step));
    for (let i = 1; i <= steps; i++) points.push([fromX + ((x - fromX) * i) / steps, fromY + ((y - fromY) * i) / steps]);
  }
  return points;
}

function runsOf(row, columns) {
  const runs = [];
  for (const column of [...columns].sort((a, b) => a - b)) {
    const last = runs[runs.length - 1];
    if (last && last.from + last.length === column) last.length++;
    else runs.push({ row, rows: 1, from: column, length: 1 });
  }
  return runs;
}

/** Equal runs in adjacent rows become one rectangle. */
function mergeRuns(runs) {
  const whole = [];
  for (const run of runs) {
    const above = whole.find(
      ({ row, rows, from, length }) => row + rows === run.row && from === run.from && length === run.length,
    );
    if (above) above.rows++;
    else whole.push(run);
  }
  return whole;
}

/** The part inside the picture, in whole pixels; null if there is none. */
function clip({ x, y, w, h }, width, height) {
  const [left, top] = [Math.max(0, Math.round(x)), Math.max(0, Math.round(y))];
  const [right, bottom] = [Math.min(width, Math.round(x + w)), Math.min(height, Math.round(y + h))];
  return right > left && bottom > top ? { x: left, y: top, w: right - left, h: bottom - top } : null;
}

/** The rectangle between two corners, clipped to the picture: a list of none or one. */
export function rectangleOf([x, y], [toX, toY], { width, height }) {
  const [left, top] = [Math.min(x, toX), Math.min(y, toY)];
  const whole = clip({ x: left, y: top, w: Math.abs(toX - x), h: Math.abs(toY - y) }, width, height);
  return whole ? [whole] : [];
}

/** annotations.json: the tools with their sizes, and every mark. Rectangles of one stroke share its number. */
export function annotationsOf({ tools, view, frames }) {
  const labels = frames.flatMap(({ number, marks }) =>
    marks.flatMap(({ id, label, rectangles }) =>
      rectangles.map(rectangle => ({
        frame: number,
        label,
        ...rectangle,
        ...(rectangles.length > 1 ? { stroke: id } : {}),
      })),
    ),
  );
  const needs = tools.some(isBare) ? { needs: 2 } : {};
  return { ...needs, ...(view ? { view } : {}), tools: tools.map(toolEntry), labels };
}

/**
 * Whether a tool has no tape: its bare shaft is its marker.
 *
 * @param {{ marker?: { kind: string } | null }} tool
 */
export const isBare = ({ marker }) => marker?.kind === 'shaft';

/** A tool as annotations.json has it. Without its own name it is named after its tape, or if bare after its side. */
export function toolEntry({ tape, name, side, diameter, band, marker }) {
  const colour = tape.trim();
  const tool = name?.trim() || (marker ? side : colour);
  return {
    tool,
    ...(tool !== colour ? { colour } : {}),
    ...(side ? { side } : {}),
    diameter_mm: diameter,
    ...(band ? { band_length_mm: band } : {}),
    ...(marker ? { marker } : {}),
  };
}

/** The labels of the tools' tapes and bare shafts, each once. */
export const coloursOf = tools => [...new Set(tools.map(({ tape }) => tape?.trim()).filter(Boolean))];

export const isMarked = (frames, label) => frames.some(({ marks }) => marks.some(mark => mark.label === label));
