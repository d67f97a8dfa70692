// Where in the picture corners were found: a cell for each part of it, and a dot for each corner.
import { html } from '../preact.js';
import { t } from '../texts.js';

export const CoverageMap = ({ needs: { coverage, cells }, photos }) => html`
  <${CellMap} coverage=${coverage} cells=${cells} size=${photos[0].check} words=${t.setup.photos.map}
    corners=${photos.flatMap(({ check }) => check.corners)} />`;

/** `words(filled, all)` says the same for people who do not see it. */
export function CellMap({ coverage: { columns, rows }, cells, size: { width, height }, words, corners = [] }) {
  const [w, h] = [width / columns, height / rows];
  const summary = words(cells.filter(count => count > 0).length, cells.length);
  return html`
    <figure class="coverage">
      <svg viewBox=${`0 0 ${width} ${height}`} role="img" aria-label=${summary}>
        ${cells.map((count, cell) => html`<rect key=${cell} x=${(cell % columns) * w} y=${Math.floor(cell / columns) * h}
          width=${w} height=${h} class=${count > 0 ? 'filled' : 'lacking'} />`)}
        ${corners.map(([x, y], index) => html`<circle key=${index} cx=${x} cy=${y} r=${width / 260} />`)}
      </svg>
      <figcaption class="small muted">${summary}</figcaption>
    </figure>`;
}
