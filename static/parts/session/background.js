// What stands behind a session: whether staff saw the attempt, and whether the same recording is filed under another trainee.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { dateTime } from '../../format.js';
import { may } from '../../roles.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Notice, ProblemNotice } from '../page/notice.js';

const words = t.background;

/**
 * Whether staff saw the attempt, in words; '' for a session from before this was recorded.
 *
 * @param {Pick<Schemas['SessionResponse'], 'supervision' | 'supervised_by' | 'supervised_at'>} session
 */
export function supervisionText({ supervision, supervised_by: by, supervised_at: at }) {
  if (!supervision) return '';
  if (supervision === 'none') return words.none;
  return words[supervision](by ?? words.deletedPerson, dateTime(at));
}

/** A line with the mark, and for staff the button that changes it. @param {Props} props */
export function Supervision({ session, person, onChange }) {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState(null);
  const isSupervised = session.supervision === 'sent_by_staff' || session.supervision === 'marked';
  const set = async supervised => {
    setBusy(true);
    setProblem(null);
    await api.sessions.supervise(session.id, { supervised }).then(onChange, error => setProblem(asProblem(error)));
    setBusy(false);
  };
  const mayMark = may(person, 'edit_sessions');
  if (session.status === 'receiving' || (!session.supervision && !mayMark)) return null;
  return html`
    <div class="row supervision">
      <span class="muted">${supervisionText(session) || words.unknown}</span>
      ${mayMark && html`<button class="button" type="button" disabled=${busy} onClick=${() => set(!isSupervised)}>${
        isSupervised ? words.undo : words.mark}</button>`}
    </div>
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />`;
}

/** The same recording under another trainee: one of them did not do it. @param {Props} props */
export function SameRecording({ session, person }) {
  const same = session.same_recording;
  if (!same) return null;
  if (!may(person, 'edit_sessions')) return html`<${Notice} tone="warn" title=${words.look}>${words.lookBody}<//>`;
  return html`
    <${Notice} tone="warn" title=${words.same}>
      ${same.sessions.length > 0 && html`<ul>${same.sessions.map(other => html`<li key=${other.id}>
        <a href=${href(['sessions', other.id])}>${words.other(other.trainee.name, other.task.name)}</a>
        ${' '}<span class="muted">(${t.session.arrived(dateTime(other.created_at))})</span></li>`)}</ul>`}
      <p>${same.sessions.length > 0 ? words.sameBody : words.sameHidden}</p>
    <//>`;
}
