// At the head of the page of a session that may show another box: the question, who may answer it, and the answer.
import { html, useState } from '../../preact.js';
import { may } from '../../roles.js';
import { t } from '../../texts.js';
import { Notice } from '../page/notice.js';
import { EditDialog } from './edit_dialog.js';
import { MoveButton } from './moves.js';

const words = t.session.boxQuestion;

/** `onChange()` runs after the answer, and after a move to another box. @param {Props} props */
export function BoxQuestion({ session, person, edits, onChange }) {
  const [answer, setAnswer] = useState(null);
  const box = session.box.name;
  if (session.box_question === 'other_box')
    return html`
      <${Notice} tone="warn" title=${words.otherTitle(box)}>
        <p>${words.other}</p>
        ${may(person, 'edit_sessions') && !session.exam && html`<div class="row"><${MoveButton} session=${session} onMoved=${onChange} /></div>`}
      <//>`;
  if (session.box_question !== 'asked') return null;
  return html`
    <${Notice} tone="warn" title=${words.title(box)}>
      <p>${words.body(box)}</p>
      ${session.exam ? html`<p>${words.ofExam}</p>` : may(person, 'edit_sessions') ? html`
        <div class="row">
          <button class="button main" type="button" onClick=${() => setAnswer('this_box')}>${words.yes(box)}</button>
          <button class="button" type="button" onClick=${() => setAnswer('other_box')}>${words.no}</button>
        </div>` : html`<p>${words.askStaff}</p>`}
      ${answer && html`<${EditDialog} kind=${answer} session=${session} tools=${[]} revision=${edits?.revision}
        onDone=${() => (setAnswer(null), onChange())} onClose=${() => setAnswer(null)} />`}
    <//>`;
}
