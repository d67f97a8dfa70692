// How the marked pixels of each label are classified.
import { html } from '../preact.js';
import { percent } from '../format.js';
import { t } from '../texts.js';

const words = t.setup.colours;
/** In the light of the marked frames; the verdicts cover other lights. */
export function Confusion({ rows }) {
  const tapes = rows[0]?.lights[0].tools.map(({ tool }) => tool) ?? [];
  if (tapes.length === 0) return null;
  return html`
    <div class="scroll" role="region" aria-label=${words.confusion} tabindex="0">
      <table class="table dense">
        <caption class="small muted">${words.confusion}</caption>
        <thead><tr><th scope="col">${t.box.label}</th><th scope="col" class="number">${words.strokes}</th>
          <th scope="col" class="number">${words.noTape}</th>
          ${tapes.map(tape => html`<th key=${tape} scope="col" class="number">${tape}</th>`)}</tr></thead>
        <tbody>
          ${rows.map(({ label, rectangles, lights: [light] }) => html`
            <tr key=${label}>
              <th scope="row">${words.labels[label] ?? label}</th>
              <td class="number">${rectangles}</td>
              <td class="number">${percent(light.no_tool)}</td>
              ${light.tools.map(({ tool, share }) => html`<td key=${tool} class="number">${percent(share)}</td>`)}
            </tr>`)}
        </tbody>
      </table>
    </div>
    ${rows.some(({ rectangles }) => rectangles === 1) && html`<p class="small muted">${words.flatters}</p>`}`;
}
