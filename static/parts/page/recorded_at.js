// When a session was recorded, and who says so: the sender states the time, and the service knows the arrival.
import { html } from '../../preact.js';
import { dateTime } from '../../format.js';
import { t } from '../../texts.js';

const words = t.session;
/** Usual time to record and send a recording, ms. A larger difference is shown. */
const MAX_USUAL_MS = 3_600_000;

/** @typedef {Pick<Schemas['SessionResponse'], 'recorded_at' | 'recorded_at_source' | 'date_known' | 'created_at'>} Times */

/** @param {Times} session */
const sourceOf = session => (session.recorded_at_source === 'claimed' && session.date_known ? 'stated' : session.recorded_at_source);

/** @param {Times} session */
function arrivalIfNotable({ recorded_at: recorded, recorded_at_source: source, created_at: arrived }) {
  const isNotable = source === 'claimed' && Math.abs(Date.parse(arrived) - Date.parse(recorded)) > MAX_USUAL_MS;
  return isNotable ? words.arrived(dateTime(arrived)) : null;
}

/**
 * The time with its source, and the arrival where it differs much.
 *
 * @param {Times} session
 */
export function recordedAtText(session) {
  const source = words.recordedAtSources[sourceOf(session)];
  return [`${dateTime(session.recorded_at)} (${source})`, arrivalIfNotable(session)].filter(Boolean).join(' · ');
}

/**
 * For lists: that the date is only claimed, and when the session arrived, where that differs much from the stated time.
 *
 * @param {{ session: Times }} props
 */
export function ArrivalNote({ session }) {
  const notes = [!session.date_known && words.claimed, arrivalIfNotable(session)].filter(Boolean);
  return notes.length > 0 && html` <span class="small muted">${notes.join(' · ')}</span>`;
}
