// How well each tool is seen, large enough to be read beside a box: the share of the recording so far, and a word. The
// service judges the recording so far as it will judge the result; the last seconds can only make the word worse.
import { html, useEffect, useState } from '../../preact.js';
import { percent } from '../../format.js';
import { t } from '../../texts.js';
import { findingText } from '../../translate.js';
import { ToolState, toolStateOf, useToolStates } from './live_tools.js';
import { ToolMark } from '../playback/readouts.js';
import { OBSERVED } from '../playback/track.js';

const words = t.record.seen;
/**
 * `QualityCause::Coverage` in measurement/src/motion/quality/limits.rs; a test in src/http/dashboard.rs compares them.
 */
const MIN_SEEN_GOOD = 0.9;
const MIN_SEEN_USABLE = 0.5;
const UPDATE_MS = 500;
/** A share of a shorter time means nothing. */
const MIN_WINDOW_S = 1;
/** From best to worst. */
const LEVELS = ['good', 'warn', 'bad'];

/** @param {Props} props */
export function SeenLevel({ watch }) {
  useToolStates(watch);
  const shares = useShares(watch);
  return html`
    <ul class="seen-level">
      ${watch.track.tools.map((tool, index) => html`<${Tool} key=${tool.name} tool=${tool} recent=${shares?.[index]}
        soFar=${watch.isFresh ? watch.seen?.[index] : null} state=${toolStateOf(watch, tool)} />`)}
    </ul>`;
}

function Tool({ tool, recent, soFar, state }) {
  const level = levelOf(soFar, recent);
  const coverage = soFar?.coverage ?? undefined;
  const isWorseNow = recent !== undefined && recentLevel(recent) > soFarLevel(soFar);
  return html`
    <li class=${`seen ${level ?? ''}`}>
      <div class="row apart">
        <strong class="tool"><${ToolMark} tool=${tool} />${tool.name}</strong>
        <${ToolState} state=${state} />
      </div>
      <div class="level" role="meter" aria-label=${words.name(tool.name)} aria-valuemin="0" aria-valuemax="100"
        aria-valuenow=${Math.round(100 * (coverage ?? 0))}><i style=${{ width: `${100 * (coverage ?? 0)}%` }}></i></div>
      <p class="row apart small">
        <span>${coverage === undefined ? words.unknown : words.share(wholePercent(coverage))}</span>
        <strong class="word">${level && words[level]}</strong>
      </p>
      ${isWorseNow && html`<p class="small">${words.recent(wholePercent(recent))}</p>`}
      ${soFar?.reason && html`<p class="small">${findingText(soFar.reason)}.</p>`}
    </li>`;
}

const wholePercent = share => percent(Math.round(share * 100) / 100);

/** The worse of the recording so far and its last seconds; null while nothing is known. */
function levelOf(soFar, recent) {
  if (soFar?.coverage === undefined || soFar?.coverage === null) return null;
  return LEVELS[Math.max(soFarLevel(soFar), recent === undefined ? 0 : recentLevel(recent))];
}

/** Judged by the service: what would happen to the session if it ended now. */
function soFarLevel(soFar) {
  if (!soFar?.reason) return 0;
  return soFar.reason.severity === 'refuse' ? 2 : 1;
}

/** Judged with the limits for whole recordings. */
function recentLevel(share) {
  if (share >= MIN_SEEN_GOOD) return 0;
  return share >= MIN_SEEN_USABLE ? 1 : 2;
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
