// One photo of the board, with what was found drawn over it; if that is not enough: why, where and what to do.
import { html } from '../preact.js';
import { serviceLang, t } from '../texts.js';
import { problemTitle } from '../translate.js';
import { ProblemDetail } from '../parts/page/prose.js';
import { sizeOf } from './photos.js';

const words = t.setup.photos;

export function PhotoCard({ photo, usual, onRemove, onRetry }) {
  const { name, url, check, state, problem } = photo;
  const isOther = check?.found && sizeOf(check) !== usual;
  const tone = check?.found && !isOther ? 'good' : state === 'checked' || state === 'failed' ? 'warn' : 'busy';
  return html`
    <li class=${`photo ${tone}`} data-photo=${name}>
      <div class="look"><img src=${url} alt=${words.alt(name)} />${check && html`<${Corners} check=${check} />`}</div>
      <div class="stack tight">
        <div class="row apart">
          <span class=${`pill ${tone}`}>${words.verdict(photo, isOther)}</span>
          <button class="button bare" type="button" aria-label=${words.removeNamed(name)} onClick=${onRemove}>${words.remove}</button>
        </div>
        <p class="small code" title=${name}>${name}</p>
        ${isOther && html`<p class="small">${words.otherSize(sizeOf(check), usual)}</p>`}
        ${check && !check.found && html`<${Why} check=${check} />`}
        ${problem && html`<p class="small">${problemTitle(problem)}. <${ProblemDetail} problem=${problem} /></p>
          <p><button class="button" type="button" onClick=${onRetry}>${t.retry}</button></p>`}
      </div>
    </li>`;
}

/** What to do comes first, then the reason that the search gives. */
const Why = ({ check }) => html`
  ${check.hints.map(hint => html`<p key=${hint} class="small">${words.hint(hint, check.cut_off)}</p>`)}
  <p class="small muted begins" lang=${serviceLang}>${check.reason}</p>`;

/** The corners of a whole board come row by row and are joined by a line; those of a part have no order. A larger ring is
 *  where a corner was not seen. */
function Corners({ check: { width, height, corners, missing, found } }) {
  const r = Math.max(width, height) / 160;
  return html`
    <svg viewBox=${`0 0 ${width} ${height}`} aria-hidden="true">
      ${found && html`<polyline points=${corners.map(corner => corner.join()).join(' ')} fill="none"
        stroke-width=${r / 2} class="joined" />`}
      ${corners.map(([x, y], index) => html`<circle key=${index} cx=${x} cy=${y} r=${r} class=${found ? 'found' : 'part'} />`)}
      ${missing.map(([x, y], index) => html`<circle key=${index} cx=${x} cy=${y} r=${2.5 * r} stroke-width=${r} class="missing" />`)}
    </svg>`;
}
