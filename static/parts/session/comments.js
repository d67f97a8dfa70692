// Comments on moments of a recording. A click goes to the moment; a new comment is pinned to the current one.
import { html, useEffect, useId, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { clock, dateTime } from '../../format.js';
import { t } from '../../texts.js';
import { Confirm } from '../forms/dialog.js';
import { ProblemNotice } from '../page/notice.js';
import { StretchButton } from './evidence.js';

const words = t.session.comments;

/** @param {Props} props */
export function Comments({ session, playback, rated }) {
  const { data, problem, reload } = useData(signal => api.sessions.comments(session.id, signal), [session.id, rated]);
  const [deleting, setDeleting] = useState(null);
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${data?.items.length === 0 && !data.hidden && html`<p class="muted">${words.empty}</p>`}
        ${data && data.hidden > 0 && html`<p class="muted">${words.hidden(data.hidden)}</p>`}
        ${data && data.items.length > 0 && html`<ul class="comments">
          ${data.items.map(comment => html`
            <li key=${comment.id}>
              <${StretchButton} stretch=${comment} playback=${playback} />
              <div>
                <p class="said">${comment.text}</p>
                <p class="small muted">${comment.own ? words.you : (comment.who ?? words.gone)} · ${
                  dateTime(comment.created_at)}</p>
              </div>
              ${comment.may_delete && html`<button class="button bare" type="button"
                aria-label=${(comment.own ? words.withdrawThis : words.deleteThis)(comment.text)}
                onClick=${() => setDeleting(comment)}>${comment.own ? words.withdraw : words.delete}</button>`}
            </li>`)}
        </ul>`}
        <${CommentForm} session=${session} playback=${playback} onAdded=${reload} />
      </div>
      ${deleting && html`<${Confirm} title=${deleting.own ? words.withdrawTitle : words.deleteTitle} body=${deleting.text}
        yes=${deleting.own ? words.withdraw : words.delete} onClose=${() => setDeleting(null)}
        onYes=${() => api.sessions.withdraw(session.id, deleting.id).then(reload)} />`}
    </section>`;
}

/** @param {Props} props */
function CommentForm({ session, playback, onAdded }) {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState(null);
  const [at, setAt] = useState(0);
  const text = useRef(null);
  const id = useId();
  // Steps of 0.1 s are enough for the button's label: it is not rendered again at every picture.
  useEffect(() => playback.onTick(({ time }) => setAt(Math.floor(time * 10) / 10)), [playback]);
  const save = async event => {
    event.preventDefault();
    if (!text.current.value.trim()) return text.current.focus();
    setBusy(true);
    setProblem(null);
    try {
      await api.sessions.comment(session.id, { from_s: playback.time, text: text.current.value });
      text.current.value = '';
      onAdded();
    } catch (error) {
      setProblem(asProblem(error));
    }
    setBusy(false);
  };
  return html`
    <form class="stack tight" onSubmit=${save}>
      <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
      <div class="field">
        <label for=${id}>${words.label}</label>
        <textarea id=${id} ref=${text} maxlength="2000" onFocus=${() => playback.pause()}></textarea>
      </div>
      <div class="row"><button class="button" type="submit" disabled=${busy}>${busy ? t.form.saving
        : words.add(clock(at))}</button></div>
    </form>`;
}
