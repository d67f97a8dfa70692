// Links for choosing a password without the old one. A link is shown once, when it is made.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { dateTime } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { CopyLine } from '../forms/copy_line.js';
import { Dialog } from '../forms/dialog.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';

const words = t.people;

/** Makes a link for the person `of`, and shows it. @param {Props} props */
export function NewLinkDialog({ of, onClose }) {
  const { data: made, problem, reload } = useData(() => api.passwordLinks.create(of.id), [of.id]);
  return html`
    <${Dialog} title=${words.linkOf(of.name)} onClose=${onClose}>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!made && !problem && html`<${Loading} />`}
      ${made && html`<p>${words.linkOnce(of.name, dateTime(made.expires_at))}</p>
        <${CopyLine} name=${words.link} text=${`${location.origin}${href(['choose-password'])}#${made.secret}`} />`}
      <div class="actions"><button class="button main" type="button" onClick=${onClose}>${t.form.close}</button></div>
    <//>`;
}

/** The links that are still valid. @param {Props} props */
export function PasswordLinks({ data, onChange }) {
  const [problem, setProblem] = useState(null);
  const withdraw = async id => {
    setProblem(null);
    await api.passwordLinks.withdraw(id).catch(error => setProblem(asProblem(error)));
    onChange();
  };
  const nameOf = link => data.people.find(one => one.id === link.person)?.name ?? link.person;
  return html`
    <section class="card">
      <header><h2>${words.links}</h2></header>
      <${ProblemNotice} problem=${problem} />
      ${data.links.length === 0 ? html`<${Empty} title=${words.noLinks} body=${words.noLinksBody} />` : html`
        <ul class="queue">
          ${data.links.map(link => html`
            <li key=${link.id}>
              <div><strong>${nameOf(link)}</strong><span class="small muted">${words.linkUntil(dateTime(link.expires_at))}</span></div>
              <button class="button bare" type="button" aria-label=${`${words.withdraw}: ${nameOf(link)}`}
                onClick=${() => withdraw(link.id)}>${words.withdraw}</button>
            </li>`)}
        </ul>`}
    </section>`;
}
