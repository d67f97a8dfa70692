// What a person who records must know now: nothing while all is well.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { fixed } from '../../format.js';
import { useLive } from '../../live.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { discardRecording, retrySending } from '../../record/recorder.js';
import { Announce, Notice } from '../page/notice.js';
import { isMoving, Outcome as SessionOutcome } from '../page/status.js';

const words = t.record;
/**
 * `QualityCause::FrameRate` in measurement/src/motion/quality/limits.rs; a test in src/http/dashboard.rs compares it.
 */
const MIN_FRAME_RATE = 14;
/** The share of frames that an encoder may skip before a notice appears. */
const MAX_SKIPPED_SHARE = 0.05;

export function RecordNotices({ recording }) {
  if (!recording) return null;
  return html`
    <${Announce}>${words.phases[recording.phase]}<//>
    ${recording.phase === 'recording' && html`<${WhileRecording} recording=${recording} />`}
    ${recording.connection === 'lost' && html`<${ConnectionLost} recording=${recording} />`}
    ${recording.lostSeconds > 0 && html`<${Notice} quiet tone="bad" title=${words.lost(fixed(recording.lostSeconds, 0))}>
      ${words.lostBody}<//>`}
    ${recording.why && html`<${Notice} tone="warn" title=${words.stopped[recording.why].title}>${words.stopped[recording.why].body}<//>`}
    <${Outcome} recording=${recording} />`;
}

function WhileRecording({ recording: { isMuted, isTurned, rate, skipped = 0, frames = 0, isCaptured } }) {
  const warnings = {
    muted: isMuted,
    turned: isTurned,
    skipped: skipped > MAX_SKIPPED_SHARE * (skipped + frames),
    slow: rate !== null && rate < MIN_FRAME_RATE,
    captured: isCaptured,
  };
  return Object.keys(warnings).filter(name => warnings[name]).map(name => html`
    <${Notice} key=${name} tone="warn" title=${words.warns[name].title}>${words.warns[name].body}<//>`);
}

function ConnectionLost({ recording: { code, kept, session } }) {
  const why = words.away[code] ?? (session ? words.cut : words.unreached);
  return html`
    <${Announce}>${why.title}<//>
    <${Notice} quiet tone="warn" title=${why.title}>${words.keeps(fixed(kept.seconds, 0))} ${why.body}<//>`;
}

/** The session of a recording that has ended, once it is scored or has failed. */
function useScored(id) {
  const [session, setSession] = useState(/** @type {Schemas['SessionResponse'] | null} */ (null));
  const read = async () => {
    const found = await api.sessions.get(id).catch(() => null);
    if (found) setSession(isMoving(found) ? null : found);
  };
  useEffect(() => void (id && read()), [id]);
  useLive('session', event => event.id === id && (isMoving(event) ? setSession(null) : read()));
  useLive('resync', () => id && read());
  return session?.id === id ? session : null;
}

/** The result of the recording, and the next actions. */
function Outcome({ recording: { phase, code, session, names, kept, exam } }) {
  // The candidate of an exam, who may stand before this screen, sees no result.
  const scored = useScored(!exam && (phase === 'ended' || phase === 'shortened') ? session : null);
  const openLink = exam ? html`<a class="button main" href=${href(['exams', exam])}>${t.exams.back}</a>` : session && html`<a class="button main" href=${href(['sessions', session])}>${words.open}</a>`;
  const dismissButton = label => html`<button class="button" type="button" onClick=${discardRecording}>${label}</button>`;
  if (phase === 'nothing') return html`<${Notice} tone="warn" title=${words.nothing}>${words.nothingBody}<//>`;
  if (phase === 'ended')
    return html`<${Notice} tone="good" title=${scored ? words.scored : words.ended}>${names} ${scored && html`<${SessionOutcome} session=${scored} />`}
      <span class="row after">${openLink}${dismissButton(words.done)}</span><//>`;
  if (phase === 'shortened')
    return html`<${Notice} tone="bad" title=${words.shortened(fixed(Math.max(1, kept.seconds), 0))}>${words.shortenedBody}
      <span class="row after">${openLink}${dismissButton(words.done)}</span><//>`;
  if (phase !== 'refused') return null;
  const { title, body } = words.refused[code] ?? words.refused.other;
  if (!session)
    return html`<${Notice} tone="bad" title=${title}>${body}<span class="row after">${dismissButton(words.done)}</span><//>`;
  const retryButton = html`<button class="button" type="button" onClick=${retrySending}>${t.retry}</button>`;
  return html`<${Notice} tone="bad" title=${title}>${body}
    <span class="row after">${retryButton}${openLink}${dismissButton(words.giveUp)}</span><//>`;
}
