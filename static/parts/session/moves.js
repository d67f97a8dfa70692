// Moving a session to the right trainee, task or box, and the list of its moves with their authors and reasons.
import { html, useState } from '../../preact.js';
import { api, Problem } from '../../api.js';
import { useData } from '../../data.js';
import { dateTime } from '../../format.js';
import { t } from '../../texts.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Loading, ProblemNotice } from '../page/notice.js';
import { boxName } from '../recording/recording_target.js';

const words = t.session.moves;
const PARTS = /** @type {const} */ (['trainee', 'task', 'box']);

/** A button that opens the dialog. `onMoved()` runs after the move. @param {Props} props */
export function MoveButton({ session, onMoved }) {
  const [asking, setAsking] = useState(false);
  return html`
    <button class="button" type="button" onClick=${() => setAsking(true)}>${words.move}</button>
    ${asking && html`<${MoveDialog} session=${session} onDone=${() => (setAsking(false), onMoved())}
      onClose=${() => setAsking(false)} />`}`;
}

/** @param {Props} props */
function MoveDialog({ session, onDone, onClose }) {
  const { data: lists, problem, reload } = useData(async () => {
    const [trainee, task, box] = await Promise.all([api.trainees.all(), api.tasks.all(), api.boxes.all()]);
    return { trainee, task, box };
  }, []);
  const selects = PARTS.map(part => ({
    name: part,
    label: t.target[part],
    type: 'select',
    value: session[part].id,
    options: withCurrent(lists?.[part] ?? [], session[part]).map(one => [one.id, part === 'box' ? boxName(one) : one.name]),
  }));
  const why = { name: 'why', label: words.why, hint: words.whyHint, type: 'textarea', required: true, maxlength: 1800, wide: true };
  const save = async given => {
    const changed = PARTS.filter(part => given[part] !== session[part].id).map(part => [part, given[part]]);
    if (!changed.length) throw new Problem({ title: words.nothing, status: 0 });
    await api.sessions.move(session.id, { ...Object.fromEntries(changed), why: given.why });
    onDone();
  };
  return html`
    <${Dialog} title=${words.title} onClose=${onClose}>
      <p>${words.does}</p>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!lists && !problem && html`<${Loading} />`}
      ${lists && html`<${Form} fields=${[...selects, why]} submit=${words.move} onSave=${save} onCancel=${onClose} />`}
    <//>`;
}

/** What a move changed. @param {Schemas['MoveChange']} change */
const changeText = ({ part, from, to }) => `${t.target[part]}: ${from?.name ?? words.unnamed} → ${to?.name ?? words.unnamed}`;

/** The list, with what the session is filed under even if the list lacks it. */
const withCurrent = (list, current) => (list.some(one => one.id === current.id) ? list : [current, ...list]);

/** The moves of a session, if there are any. @param {Props} props */
export function Moves({ session }) {
  const filed = PARTS.map(part => session[part].id).join();
  const { data } = useData(signal => api.sessions.moves(session.id, signal), [session.id, filed]);
  if (!data?.items.length) return null;
  return html`
    <details class="card moves">
      <summary>${words.list(data.items.length)}</summary>
      <ul class="edit-list">${data.items.map(made => html`
        <li key=${made.id}><div>
          ${made.changes.map(change => html`<strong key=${change.part}>${changeText(change)}</strong>`)}
          ${made.why && html`<p class="said">${made.why}</p>`}
          <p class="small muted">${made.who ?? t.session.edits.gone}, ${dateTime(made.created_at)}</p>
        </div></li>`)}</ul>
    </details>`;
}
