// The current values per tool, and buttons that hide a tool in overlay, curves and path at once.
import { html, useEffect, useRef } from '../../preact.js';
import { fixed } from '../../format.js';
import { t } from '../../texts.js';
import { whyUnseen } from './overlay.js';
import { isExact } from './track.js';

const words = t.session;
const VALUES = [
  ['x_mm', 1],
  ['y_mm', 1],
  ['z_mm', 1],
  ['speed', 0],
];

/** A tool's shape in its colour, as on the video. */
export const ToolMark = ({ tool }) => html`
  <svg class="mark" viewBox="0 0 16 16" width="14" height="14" fill="none" stroke=${tool.ink()} stroke-width="2.5"
    stroke-linejoin="round" aria-hidden="true">
    ${tool.shape === 'circle' && html`<circle cx="8" cy="8" r="5.5" />`}
    ${tool.shape === 'diamond' && html`<path d="M8 1.5 14.5 8 8 14.5 1.5 8z" />`}
    ${tool.shape === 'square' && html`<path d="M3 3h10v10H3z" />`}
    ${tool.shape === 'triangle' && html`<path d="M8 2 14.5 13.500h-13z" />`}
  </svg>`;

export const ToolSwitches = ({ track, hidden, onToggle }) => html`
  <div class="tools" role="group" aria-label=${words.tool}>
    ${track.tools.map(tool => html`
      <button key=${tool.name} type="button" class="button tool" aria-pressed=${!hidden.has(tool.name)}
        onClick=${() => onToggle(tool.name)}>
        <${ToolMark} tool=${tool} />${tool.name}
      </button>`)}
  </div>`;

/** @param {Props} props */
export function Readouts({ track, playback }) {
  const cells = useRef({});
  useEffect(
    () =>
      playback.onTick(({ frame }) => {
        for (const tool of track.tools) {
          const exact = isExact(track, frame); // Interpolated values are drawn, but not shown as numbers.
          for (const [field, digits] of VALUES)
            cells.current[`${tool.name} ${field}`].textContent = fixed(exact ? tool[field][frame] : NaN, digits);
          const why = whyUnseen(tool, frame);
          const state = exact ? words.states[tool.state[frame]] + (why && `: ${why}`) : t.loading;
          const stateCell = cells.current[`${tool.name} state`];
          // The cell may cut the text off; its title shows all of it.
          if (stateCell.textContent !== state) stateCell.textContent = stateCell.title = state;
        }
      }),
    [track],
  );
  const cell = key => element => (cells.current[key] = element);
  return html`
    <div class="scroll" tabindex="0" role="region" aria-label=${words.readouts}>
      <table class="table dense readouts">
        <thead>
          <tr>
            <th scope="col">${words.tool}</th>
            ${['x', 'y', 'z', 'speed'].map(name => html`<th scope="col" class="number" key=${name}>
              ${words[name]}</th>`)}
            <th scope="col" class="state">${words.state}</th>
          </tr>
        </thead>
        <tbody>
          ${track.tools.map(tool => html`
              <tr key=${tool.name}>
                <th scope="row"><span class="tool"><${ToolMark} tool=${tool} />${tool.name}</span></th>
                ${VALUES.map(([field]) => html`<td key=${field} class="number"
                  ref=${cell(`${tool.name} ${field}`)}></td>`)}
                <td class="state" ref=${cell(`${tool.name} state`)}></td>
              </tr>`)}
        </tbody>
      </table>
    </div>`;
}
