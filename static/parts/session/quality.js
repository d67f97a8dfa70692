// How much of each tool was seen, and why not more. A score is only half true without it.
import { html } from '../../preact.js';
import { fixed, number, percent } from '../../format.js';
import { t } from '../../texts.js';

const words = t.session;
const STATES = ['observed', 'predicted', 'missing'];

/** @param {Props} props */
export const Quality = ({ quality }) => html`
  <div class="stack">
    <p class="small muted">${words.frames(quality.frames)}</p>
    ${quality.tools.map(tool => html`<${Tool} key=${tool.tool} tool=${tool} />`)}
    <div class="key small" aria-hidden="true">
      ${STATES.map(state => html`<span key=${state}><i class=${`share-${state}`}></i>${words[state]}</span>`)}
    </div>
  </div>`;

function Tool({ tool }) {
  const all = STATES.reduce((sum, state) => sum + (tool[state] ?? 0), 0) || 1;
  const share = state => percent((tool[state] ?? 0) / all);
  const reasons = Object.entries(tool.reasons ?? {})
    .filter(([, count]) => count > 0)
    .sort((a, b) => b[1] - a[1]);
  return html`
    <section class="stack tight">
      <div class="row apart">
        <h3>${tool.tool}</h3>
        ${Number.isFinite(tool.border_residual_px) && html`<span class="small muted">
          ${words.residual(number(tool.border_residual_px))}</span>`}
      </div>
      <div class="shares" aria-hidden="true">
        ${STATES.filter(state => tool[state] > 0).map(state => html`<span key=${state} class=${`share-${state}`}
          style=${{ flexGrow: tool[state] }}></span>`)}
      </div>
      <p class="small">${words.shares(share('observed'), share('predicted'), share('missing'))}</p>
      <dl class="facts small">
        ${Object.entries(figures(tool, all)).filter(([, text]) => text).map(([name, text]) => html`
          <dt key=${name}>${words.figures[name]}</dt><dd>${text}</dd>`)}
      </dl>
      ${reasons.length > 0 && html`
        <details class="small">
          <summary>${words.why}</summary>
          <ul class="reasons">
            ${reasons.map(([reason, count]) => html`<li key=${reason}><span>${words.reasons[reason] ?? reason}</span>
              <span class="number">${words.frames(count)}</span></li>`)}
          </ul>
        </details>`}
    </section>`;
}

/** The figures of a tool besides its shares; shares of zero are left out, and gaps of a tool that was always seen. */
function figures(tool, all) {
  const { noise_floor: noise, effective_diameter: diameter, port_shift: port } = tool;
  return {
    left_view_share: tool.left_view_share > 0 && percent(tool.left_view_share),
    lost_share: tool.lost_share > 0 && percent(tool.lost_share),
    longest_gap_s: tool.observed < all && Number.isFinite(tool.longest_gap_s) && `${number(tool.longest_gap_s)} s`,
    noise_floor: noise && words.noise(number(noise.smoothed_mm_s), noise.causal_mm_s && number(noise.causal_mm_s)),
    error_median_mm: Number.isFinite(tool.error_median_mm) &&
      words.error(number(tool.error_median_mm), number(tool.error_p95_mm)),
    effective_diameter: diameter && words.diameter(fixed(diameter.mm, 2), fixed(diameter.sigma_mm, 2), diameter.basis),
    port_shift: port && words.portShift(fixed(port.mm, 1), fixed(port.sigma_mm, 1)),
  };
}
