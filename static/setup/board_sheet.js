// The checkerboard on a sheet of A4, in true millimetres: one user unit of the picture is one millimetre of paper.
import { html } from '../preact.js';
import { t } from '../texts.js';

const words = t.setup.board;
const SHEET = { width: 297, height: 210 };
const TOP_MM = 10;
export const RULER_MM = 100;
/** Below the board: a white margin, the ruler, one line of text. */
const BELOW_MM = 36;
/** The margin that printers leave white at the sides. */
const SIDE_MM = 8;

export function fits({ columns, rows, printed }) {
  const [width, height] = [(columns + 1) * printed, (rows + 1) * printed];
  return width <= SHEET.width - 2 * SIDE_MM && height <= SHEET.height - TOP_MM - BELOW_MM;
}

export function BoardSheet({ plan }) {
  const square = plan.printed;
  const [columns, rows] = [plan.columns + 1, plan.rows + 1];
  const left = (SHEET.width - columns * square) / 2;
  const bottom = TOP_MM + rows * square;
  const dark = [];
  for (let row = 0; row < rows; row++)
    for (let column = row % 2; column < columns; column += 2) dark.push(`M${left + column * square} ${TOP_MM + row * square}h${square}v${square}h${-square}z`);
  return html`
    <svg class="sheet" viewBox=${`0 0 ${SHEET.width} ${SHEET.height}`} role="img" aria-label=${words.sheet(plan)}>
      <rect width=${SHEET.width} height=${SHEET.height} fill="#fff" />
      <path d=${dark.join('')} fill="#000" />
      <${Ruler} x=${(SHEET.width - RULER_MM) / 2} y=${bottom + 18} />
      <text x=${SHEET.width / 2} y=${bottom + 31} text-anchor="middle" font-size="3.6" fill="#000">${words.onSheet(plan, square, RULER_MM)}</text>
    </svg>`;
}

/** A line each millimetre, longer ones each 5 and 10. */
function Ruler({ x, y }) {
  const strokes = Array.from({ length: RULER_MM + 1 }, (_, mm) => {
    const length = mm % 10 === 0 ? 6 : mm % 5 === 0 ? 4 : 2.5;
    return `M${x + mm} ${y}v${length}`;
  });
  return html`
    <path d=${`M${x} ${y}h${RULER_MM}${strokes.join('')}`} stroke="#000" stroke-width="0.25" stroke-linecap="square" fill="none" />
    ${Array.from({ length: RULER_MM / 10 + 1 }, (_, ten) => html`<text key=${ten} x=${x + 10 * ten} y=${y - 1.5}
      text-anchor="middle" font-size="3" fill="#000">${10 * ten}</text>`)}`;
}
