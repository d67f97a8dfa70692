// The state of each tool while a session arrives, large enough to be read from a distance, and the position of its tip.
import { html, useEffect, useReducer, useRef } from '../../preact.js';
import { fixed } from '../../format.js';
import { t } from '../../texts.js';
import { icons } from '../page/icons.js';
import { Announce } from '../page/notice.js';
import { ToolMark } from '../playback/readouts.js';

const words = t.watch;
const STYLES = {
  seen: { tone: 'good', icon: icons.good },
  bridged: { tone: 'busy', icon: icons.bridge },
  left_view: { tone: 'warn', icon: icons.leave },
  lost: { tone: 'bad', icon: icons.warning },
  unknown: { tone: '', icon: icons.info },
};
/** Numbers are updated at this interval, ms: faster ones cannot be read. */
const UPDATE_MS = 100;

/** The state to show. When nothing arrives any more, the last state is not valid: unknown. */
export const toolStateOf = (watch, tool) => (watch.isFresh && tool.shown.state) || 'unknown';

/** Renders the component again when the state or the reason of a tool changes. */
export function useToolStates(watch) {
  const [, render] = useReducer(/** @param {number} count */ count => count + 1, 0);
  useEffect(() => {
    let before = '';
    return watch.onTick(() => {
      const now = watch.track?.tools.map(({ shown }) => `${shown.state} ${shown.reason} ${shown.spoken}`).join();
      if (now === before) return;
      before = now;
      render(undefined);
    });
  }, [watch]);
}

/** A tool's state as an icon and a word. */
export function ToolState({ state }) {
  const { tone, icon: Icon } = STYLES[state];
  return html`<span class=${`pill sign ${tone}`}><${Icon} size="18" />${words.tool[state]}</span>`;
}

/** @param {Props} props */
export function LiveTools({ watch }) {
  useToolStates(watch);
  const { track } = watch;
  const spoken = watch.isFresh && track.tools.filter(tool => tool.shown.spoken);
  return html`
    <${Announce}>${spoken && spoken.map(tool => words.spoken(tool.name, words.tool[tool.shown.spoken])).join(' ')}<//>
    <div class="live-tools">
      ${track.tools.map(tool => html`<${Tool} key=${tool.name} tool=${tool} watch=${watch} />`)}
    </div>
    ${track.tools.length === 2 && html`<${Distance} watch=${watch} />`}`;
}

/** @param {Props} props */
function Tool({ tool, watch }) {
  const state = toolStateOf(watch, tool);
  const cells = useRef({});
  useEffect(() => {
    const write = (name, value, digits) => (cells.current[name].textContent = fixed(value, digits));
    return onReadable(watch, ({ track, isFresh }) => {
      const at = field => (isFresh && track.frames ? tool[field][track.last] : NaN);
      for (const axis of ['x', 'y', 'z']) write(axis, at(`${axis}_mm`), 1);
      for (const axis of ['x', 'y']) cells.current[`${axis}±`].textContent = plusMinus(at('sigma_xy_mm'));
      cells.current['z±'].textContent = plusMinus(at('sigma_z_mm'));
      write('speed', at('speed'), 0);
    });
  }, [watch, tool]);
  const cell = name => element => (cells.current[name] = element);
  return html`
    <section class=${`card live-tool ${STYLES[state].tone}`} aria-label=${tool.name}>
      <header><h2 class="tool"><${ToolMark} tool=${tool} />${tool.name}</h2></header>
      <div class="how">
        <strong><${Sign} state=${state} />${words.tool[state]}</strong>
        <p class="small">${why(state, tool.shown.reason)}</p>
      </div>
      <table class="position">
        <tbody>
          ${['x', 'y', 'z'].map(axis => html`
            <tr key=${axis}>
              <th scope="row">${axis}</th>
              <td ref=${cell(axis)}></td><td class="sigma" ref=${cell(`${axis}±`)}></td><td>mm</td>
            </tr>`)}
          <tr><th scope="row">${words.speed}</th><td ref=${cell('speed')}></td><td></td><td>mm/s</td></tr>
        </tbody>
      </table>
    </section>`;
}

function Sign({ state }) {
  const Icon = STYLES[state].icon;
  return html`<${Icon} size="24" />`;
}

/** Why a tool is not seen, or what its state means. */
function why(state, reason) {
  if (state === 'left_view') return words.leftView;
  const reasonText = reason && (t.session.reasons[reason] ?? reason);
  if (state === 'lost') return reasonText ? words.because(reasonText) : words.nowhere;
  if (state === 'bridged') return reasonText ? words.because(reasonText) : words.byMotion;
  return words.means[state];
}

/** @param {Props} props */
function Distance({ watch }) {
  const value = useRef(null);
  const sigma = useRef(null);
  useEffect(
    () =>
      onReadable(watch, ({ track, isFresh }) => {
        const [distance, error] = (isFresh && track?.distance) || [NaN, NaN];
        value.current.textContent = fixed(distance, 1);
        sigma.current.textContent = plusMinus(error);
      }),
    [watch],
  );
  return html`
    <dl class="card distance">
      <dt>${words.distance}</dt>
      <dd><span ref=${value}></span> <span class="sigma" ref=${sigma}></span> mm</dd>
    </dl>`;
}

const plusMinus = sigma => (Number.isFinite(sigma) ? `± ${fixed(sigma, 1)}` : '');

/** Calls `write` as often as numbers can be read, and once more when nothing arrives any more. */
function onReadable(watch, write) {
  let [writtenAt, wasFresh] = [-Infinity, null];
  return watch.onTick(() => {
    const now = performance.now();
    if (now - writtenAt < UPDATE_MS && watch.isFresh === wasFresh) return;
    [writtenAt, wasFresh] = [now, watch.isFresh];
    write(watch);
  });
}
