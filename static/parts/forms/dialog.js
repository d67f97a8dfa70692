// The browser's own dialog: it keeps the focus inside, closes on Escape and gives the focus back.
import { html, useEffect, useId, useRef, useState } from '../../preact.js';
import { asProblem } from '../../data.js';
import { t } from '../../texts.js';
import { ProblemNotice } from '../page/notice.js';

export function Dialog({ title, onClose, children }) {
  const box = useRef(null);
  const id = useId();
  useEffect(() => {
    box.current.showModal();
  }, []);
  return html`
    <dialog ref=${box} aria-labelledby=${id} onClose=${onClose}>
      <div class="inner">
        <h2 id=${id}>${title}</h2>
        ${children}
      </div>
    </dialog>`;
}

/** Asks before an action that cannot be undone; the harmless button has the focus. */
export function Confirm({ title, body, yes, no = t.form.cancel, onYes, onClose }) {
  const [problem, setProblem] = useState(null);
  const act = () => onYes().then(onClose, error => setProblem(asProblem(error)));
  return html`
    <${Dialog} title=${title} onClose=${onClose}>
      <${ProblemNotice} problem=${problem} />
      <p>${body}</p>
      <div class="actions">
        <button class="button" type="button" autofocus onClick=${onClose}>${no}</button>
        <button class="button danger" type="button" onClick=${act}>${yes}</button>
      </div>
    <//>`;
}
