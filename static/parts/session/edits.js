// The edits of a session: trims, swapped tool names, set aside. Who made each, when and why, and how to undo it.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { dateTime, number } from '../../format.js';
import { may } from '../../roles.js';
import { t } from '../../texts.js';
import { problemTitle } from '../../translate.js';
import { CutButton } from './cuts.js';
import { EditDialog } from './edit_dialog.js';
import { Notice, ProblemNotice } from '../page/notice.js';
import { spanName, useMarked } from './span_bar.js';
import { ProblemDetail } from '../page/prose.js';

const words = t.session.edits;

/**
 * `edits`: the answer of `GET edits`; `onEdited()` runs after each change; `tools`: the names of the session's tools.
 *
 * @param {Props} props
 */
export function Edits({ session, person, edits, playback, tools, onEdited }) {
  const { marked } = useMarked(playback);
  const [dialogKind, setDialogKind] = useState(null);
  const [problem, setProblem] = useState(null);
  if (!edits) return null;
  const mayEdit = may(person, 'edit_sessions') && !session.exam;
  const isInForce = edit => !edit.undone && !edit.for_other_box;
  const [inForce, undone] = [edits.items.filter(isInForce), edits.items.filter(edit => !isInForce(edit))];
  if (!mayEdit && !inForce.length) return null;
  const undo = edit => api.sessions.undo(session.id, edit.id).then(onEdited, error => setProblem(asProblem(error)));
  const scored = session.status === 'done' && tools.length > 0;
  return html`
    <section class="card edits">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
        <${Score} edits=${edits} mayEdit=${mayEdit} onAgain=${onEdited} />
        ${mayEdit && html`
          <div class="row">
            ${scored && html`<button class="button" type="button" disabled=${!marked} onClick=${() => setDialogKind('trim')}>${
              marked ? words.trim(spanName(marked)) : words.kinds.trim}</button>`}
            ${scored && tools.length > 1 && html`<button class="button" type="button" disabled=${!marked}
              onClick=${() => setDialogKind('swap')}>${marked ? words.swap(spanName(marked)) : words.kinds.swap}</button>`}
            ${mayRetime(session) && html`<button class="button" type="button" onClick=${() => setDialogKind('retime')}>${
              words.kinds.retime}</button>`}
            ${!session.set_aside && html`<button class="button" type="button" onClick=${() => setDialogKind('set_aside')}>${
              words.kinds.set_aside}</button>`}
            ${scored && edits.score === 'current' && html`<${CutButton} session=${session}
              playback=${playback} onCut=${onEdited} />`}
          </div>
          ${scored && !marked && html`<p class="small muted">${words.markFirst}</p>`}`}
        ${inForce.length > 0 && html`<ul class="edit-list">${inForce.map(edit => html`
          <li key=${edit.id}><${EditEntry} edit=${edit} />
            ${mayEdit && !edit.of_cut && html`<button class="button" type="button" aria-label=${words.undoThis(editText(edit))}
              onClick=${() => undo(edit)}>${words.undo}</button>`}</li>`)}</ul>`}
        ${undone.length > 0 && html`<details class="small"><summary>${words.undone(undone.length)}</summary>
          <ul class="edit-list">${undone.map(edit => html`<li key=${edit.id}><${EditEntry} edit=${edit} /></li>`)}</ul></details>`}
      </div>
      ${dialogKind && html`<${EditDialog} kind=${dialogKind} session=${session} span=${marked} tools=${tools} revision=${edits.revision}
        onDone=${() => (setDialogKind(null), playback.mark(0, 0), onEdited())} onClose=${() => setDialogKind(null)} />`}
    </section>`;
}

/** Times can be corrected even if the session could not be tracked, but not those of a file that cannot be read. An imported
 *  table has its own times. */
const mayRetime = session => session.retry_can_help && ['done', 'failed'].includes(session.status);

/** The effect of an edit, in words. @param {Schemas['EditResponse']} edit */
const editText = ({ kind, from_s: from, to_s: to, tools, true_frame_rate_hz: rate, true_duration_s: length }) => {
  if (kind === 'retime') return Number.isFinite(rate) ? words.rateIs(number(rate)) : words.lengthIs(number(length));
  return words.says[kind](from === null ? '' : spanName([from, to]), tools ?? []);
};

/** The service's own words, where it writes the reason. */
const FROM_SERVICE = { 'Given with the recording.': words.withRecording };

/** The author. An edit that came with a recording may be from the computer that sent it. */
const author = edit => edit.who ?? (FROM_SERVICE[edit.why] ? words.senderGone : words.gone);

/** @param {Props} props */
const EditEntry = ({ edit }) => html`
  <div>
    <strong>${editText(edit)}</strong>
    <p class="said">${FROM_SERVICE[edit.why] ?? edit.why}</p>
    <p class="small muted">${author(edit)}, ${dateTime(edit.created_at)}${edit.undone &&
      ` · ${words.undoneBy(edit.undone.who ?? words.gone, dateTime(edit.undone.at))}`}${
      !edit.undone && edit.for_other_box && ` · ${words.beforeMove}`}</p>
  </div>`;

/** Between an edit and its score, the old numbers are shown, and the notice says so. @param {Props} props */
function Score({ edits, mayEdit, onAgain }) {
  if (edits.score === 'current') return null;
  if (edits.score !== 'failed') return html`<${Notice} title=${words.making}>${words.makingBody}<//>`;
  const again = mayEdit && edits.job ? () => api.jobs.retry(edits.job).then(onAgain, onAgain) : undefined;
  const why = edits.error && html`${problemTitle(edits.error)}. <${ProblemDetail} problem=${edits.error} />`;
  return html`<${ProblemNotice} problem=${{ title: words.failed, detail: why }} onRetry=${again} />`;
}

/**
 * At the head of the page of a session whose times are not those of its file: why, from what to what, and who corrected
 * them. If the recording may be slow motion, or its stamps may run at a wrong pace: how to correct it.
 *
 * @param {Props} props
 */
export function Retimed({ session, edits }) {
  const { clock, duration_s: duration, may_be_slow_motion: isDoubtful, arrival } = session.video ?? {};
  if (arrival && duration && session.video?.may_run_at_wrong_pace) {
    const { arrived_s: arrived, stamped_s: stamped } = arrival;
    return html`<${Notice} tone="warn" title=${t.session.retimed.paceTitle}>${
      t.session.retimed.pace(number(stamped), number(arrived), number(duration * arrived / stamped))}<//>`;
  }
  if (!clock || (clock.basis === 'stamps' && !isDoubtful)) return null;
  const { factor, capture_rate_hz: captured, stamped_frame_rate_hz: rate, stamped_duration_s: length } = clock;
  if (isDoubtful)
    return html`<${Notice} tone="warn" title=${t.session.retimed.doubtTitle}>${
      t.session.retimed.doubt(number(captured), number(rate))}<//>`;
  const edit = edits?.items.findLast(one => one.kind === 'retime' && !one.undone);
  const said = t.session.retimed;
  const isTagged = clock.basis === 'capture_rate';
  const title = isTagged ? (factor < 1 ? said.slowTitle : said.lapseTitle) : said.title;
  return html`<${Notice} title=${title}>
    ${isTagged && `${said.captured(number(captured))} `}${
      said.from(number(rate), number(length), number(rate && rate / factor), number(duration))}${' '}
    ${isTagged ? said.wrong : edit && said.by(author(edit), dateTime(edit.created_at))}<//>`;
}

/** At the head of the page of a session that does not count. @param {Props} props */
export function SetAside({ session, edits }) {
  if (!session.set_aside) return null;
  const edit = edits?.items.find(one => one.kind === 'set_aside' && !one.undone);
  return html`<${Notice} tone="warn" title=${words.aside}>${edit
    ? words.asideBy(edit.why, edit.who ?? words.gone, dateTime(edit.created_at)) : words.asideBody}<//>`;
}
