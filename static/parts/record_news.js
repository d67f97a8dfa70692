// What somebody who records must know now: nothing while all is well.
import { html } from './preact.js';
import { fixed } from '../format.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { forget, retry } from '../record/recorder.js';
import { Announce, Notice } from './notice.js';

const words = t.record;
/** `Cause::FrameRate` in src/pipeline/quality/limits.rs; src/http/dashboard.rs has a test of it. */
const LEAST_RATE = 14;
/** Of the frames: what an encoder may leave out before it is said. */
const MOST_SKIPPED = 0.05;

export function RecordNews({ now }) {
  if (!now) return null;
  return html`
    <${Announce}>${words.phases[now.phase]}<//>
    ${now.phase === 'recording' && html`<${WhileRecording} now=${now} />`}
    ${now.line === 'lost' && html`<${Lost} now=${now} />`}
    ${now.lostSeconds > 0 && html`<${Notice} quiet tone="bad" title=${words.lost(fixed(now.lostSeconds, 0))}>
      ${words.lostBody}<//>`}
    ${now.why && html`<${Notice} tone="warn" title=${words.stopped[now.why].title}>${words.stopped[now.why].body}<//>`}
    <${Over} now=${now} />`;
}

function WhileRecording({ now: { isMuted, isTurned, rate, skipped = 0, frames = 0, isCaptured } }) {
  const told = {
    muted: isMuted,
    turned: isTurned,
    skipped: skipped > MOST_SKIPPED * (skipped + frames),
    slow: rate !== null && rate < LEAST_RATE,
    captured: isCaptured,
  };
  return Object.keys(told).filter(name => told[name]).map(name => html`
    <${Notice} key=${name} tone="warn" title=${words.warns[name].title}>${words.warns[name].body}<//>`);
}

function Lost({ now: { code, kept, session } }) {
  const why = words.away[code] ?? (session ? words.cut : words.unreached);
  return html`
    <${Announce}>${why.title}<//>
    <${Notice} quiet tone="warn" title=${why.title}>${words.keeps(fixed(kept.seconds, 0))} ${why.body}<//>`;
}

/** What became of it, and what comes next. */
function Over({ now: { phase, code, session, names, kept } }) {
  const open = session && html`<a class="button main" href=${href(['sessions', session])}>${words.open}</a>`;
  const away = label => html`<button class="button" type="button" onClick=${forget}>${label}</button>`;
  if (phase === 'nothing') return html`<${Notice} tone="warn" title=${words.nothing}>${words.nothingBody}<//>`;
  if (phase === 'ended')
    return html`<${Notice} tone="good" title=${words.ended}>${names}
      <span class="row after">${open}${away(words.done)}</span><//>`;
  if (phase === 'shortened')
    return html`<${Notice} tone="bad" title=${words.shortened(fixed(Math.max(1, kept.seconds), 0))}>${words.shortenedBody}
      <span class="row after">${open}${away(words.done)}</span><//>`;
  if (phase !== 'refused') return null;
  const { title, body } = words.refused[code] ?? words.refused.other;
  if (!session)
    return html`<${Notice} tone="bad" title=${title}>${body}<span class="row after">${away(words.done)}</span><//>`;
  const again = html`<button class="button" type="button" onClick=${retry}>${t.retry}</button>`;
  return html`<${Notice} tone="bad" title=${title}>${body}
    <span class="row after">${again}${open}${away(words.giveUp)}</span><//>`;
}
