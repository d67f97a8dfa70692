// How well each tool was seen in the last seconds, large enough to be read beside a box: the share of frames, and a
// word.
import { html, useEffect, useState } from '../../preact.js';
import { percent } from '../../format.js';
import { t } from '../../texts.js';
import { ToolState, toolStateOf, useToolStates } from './live_tools.js';
import { ToolMark } from '../playback/readouts.js';
import { OBSERVED } from '../playback/track.js';

const words = t.record.seen;
/** `QualityCause::Coverage` in src/motion/quality/limits.rs; a test in src/http/dashboard.rs compares them. */
const MIN_SEEN_GOOD = 0.9;
const MIN_SEEN_USABLE = 0.5;
const UPDATE_MS = 500;
/** A share of a shorter time means nothing. */
const MIN_WINDOW_S = 1;

/** @param {Props} props */
export function SeenLevel({ watch }) {
  useToolStates(watch);
  const shares = useShares(watch);
  return html`
    <ul class="seen-level">
      ${watch.track.tools.map((tool, index) => html`<${Tool} key=${tool.name} tool=${tool} share=${shares?.[index]}
        state=${toolStateOf(watch, tool)} />`)}
    </ul>`;
}

function Tool({ tool, share, state }) {
  const level = levelOf(share);
  return html`
    <li class=${`seen ${level ?? ''}`}>
      <div class="row apart">
        <strong class="tool"><${ToolMark} tool=${tool} />${tool.name}</strong>
        <${ToolState} state=${state} />
      </div>
      <div class="level" role="meter" aria-label=${words.name(tool.name)} aria-valuemin="0" aria-valuemax="100"
        aria-valuenow=${Math.round(100 * (share ?? 0))}><i style=${{ width: `${100 * (share ?? 0)}%` }}></i></div>
      <p class="row apart small">
        <span>${share === undefined ? words.unknown : words.share(percent(Math.round(share * 100) / 100))}</span>
        <strong class="word">${level && words[level]}</strong>
      </p>
    </li>`;
}

/** Judged with the limits for whole recordings. */
function levelOf(share) {
  if (share === undefined) return null;
  if (share >= MIN_SEEN_GOOD) return 'good';
  return share >= MIN_SEEN_USABLE ? 'warn' : 'bad';
}

function useShares(watch) {
  const [shares, setShares] = useState(null);
  useEffect(() => {
    const count = () => setShares(watch.isFresh ? sharesOf(watch.track) : null);
    const timer = setInterval(count, UPDATE_MS);
    return () => clearInterval(timer);
  }, [watch]);
  return shares;
}

function sharesOf({ tools, times, first, last, frames }) {
  if (!frames || times[last] - times[first] < MIN_WINDOW_S) return null;
  return tools.map(({ state }) => {
    let seen = 0;
    for (let row = first; row < frames; row++) seen += Number(state[row] === OBSERVED);
    return seen / (frames - first);
  });
}
