// Issued certificates: what each says, whether it is valid, its file, and what staff decide about it.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { calendarDay, date, dateTime } from '../../format.js';
import { href } from '../../router.js';
import { may } from '../../roles.js';
import { t } from '../../texts.js';
import { asProblem, useData } from '../../data.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Empty, Loading, Notice, ProblemNotice } from '../page/notice.js';

const words = t.certificates;
const TONES = { valid: 'good', under_review: 'warn', withdrawn: 'bad', erased: '' };

export const StatePill = ({ state }) => html`<span class=${`pill ${TONES[state]}`}>${words.states[state]}</span>`;

/** The certificates of one trainee, as a card; nothing for a trainee who has none, unless `always`. @param {Props} props */
export function CertificatesCard({ trainee, person, always = false }) {
  const { data, problem, reload } = useData(signal => api.certificates.page({ trainee, limit: 200 }, signal), [trainee]);
  if (!always && !problem && !data?.items.length) return null;
  return html`
    <section class="card certificates" id="certificates">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${!data && !problem && html`<${Loading} />`}
        ${data?.items.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
        ${data && html`<${CertificateList} certificates=${data.items} person=${person} onChange=${reload} />`}
      </div>
    </section>`;
}

/** `withNames`: also says whose each is. @param {Props} props */
export function CertificateList({ certificates, person, withNames = false, onChange }) {
  const [asked, setAsked] = useState(null); // { certificate, action }
  const ask = (certificate, action) => () => setAsked({ certificate, action });
  return html`
    <ul class="edit-list">${certificates.map(certificate => html`
      <li key=${certificate.id}><${Entry} certificate=${certificate} person=${person} withNames=${withNames} ask=${ask} /></li>`)}</ul>
    ${asked?.action === 'history' && html`<${HistoryDialog} certificate=${asked.certificate} onClose=${() => setAsked(null)} />`}
    ${asked && asked.action !== 'history' && html`<${ReasonDialog} ...${asked} onDone=${() => (setAsked(null), onChange())} onClose=${() => setAsked(null)} />`}`;
}

/** @param {Props} props */
function Entry({ certificate, person, withNames, ask }) {
  const { content, state } = certificate;
  const isAdministrator = may(person, 'people');
  return html`
    <div>
      <strong>${withNames ? html`<a href=${href(['trainees', certificate.trainee])}>${content.trainee}</a>, ` : ''}${content.task}</strong> <${StatePill} state=${state} />
      <p class="small muted">${words.earned(calendarDay(content.earned_on), content.standard.version)} ${words.issued(date(certificate.issued_at), content.issuer)} ${words.inLanguage[content.language]}</p>
      ${state === 'withdrawn' && html`<p class="small">${words.withdrawnFor(date(certificate.state_at))} <span class="said">${certificate.reason}</span></p>`}
      ${state === 'under_review' && html`<p class="small">${words.reviewSince(date(certificate.state_at))}</p>`}
      <p class="row">
        <a class="button" href=${api.certificates.pdfAddress(certificate.id)} download>${words.download}</a>
        <a class="button bare" target="_blank" rel="noopener" href=${href(['verify', content.code])}>${words.publicPage}</a>
        <button class="button bare" type="button" onClick=${ask(certificate, 'history')}>${words.history}</button>
        ${state === 'under_review' && may(person, 'edit_sessions') && html`<button class="button" type="button" onClick=${ask(certificate, 'keep')}>${words.keep}</button>`}
        ${isAdministrator && (state === 'valid' || state === 'under_review') && html`<button class="button" type="button" onClick=${ask(certificate, 'withdraw')}>${words.withdraw}</button>`}
        ${isAdministrator && state === 'withdrawn' && html`<button class="button" type="button" onClick=${ask(certificate, 'reinstate')}>${words.reinstate}</button>`}
      </p>
    </div>`;
}

/** Keeps, withdraws or reinstates a certificate, with a reason. @param {Props} props */
function ReasonDialog({ certificate, action, onDone, onClose }) {
  const fields = [{ name: 'reason', label: words.reason, hint: words.reasonHints[action], type: 'textarea', required: true, maxlength: 2000, wide: true, rows: 3 }];
  const save = ({ reason }) => api.certificates[action](certificate.id, reason).then(onDone);
  return html`
    <${Dialog} title=${words.actions[action]} onClose=${onClose}>
      <p>${words.about(certificate.content.trainee, certificate.content.task)} ${words.actionBodies[action]}</p>
      <${Form} fields=${fields} submit=${words[action]} onSave=${save} onCancel=${onClose} />
    <//>`;
}

/** @param {Props} props */
function HistoryDialog({ certificate, onClose }) {
  const { data, problem, reload } = useData(signal => api.certificates.get(certificate.id, signal), [certificate.id]);
  return html`
    <${Dialog} title=${words.history} onClose=${onClose}>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      <ul class="edit-list">${data?.events.map((one, at) => html`
        <li key=${at}><div><strong>${eventText(one)}</strong>
          <p class="small muted">${[dateTime(one.at), one.who].filter(Boolean).join(', ')}</p>
          ${one.reason && html`<p class="small said">${one.reason}</p>`}</div></li>`)}</ul>
      <div class="actions"><button class="button" type="button" onClick=${onClose}>${words.close}</button></div>
    <//>`;
}

/** What happened, with the number of the session. @param {{ event: Schemas['CertificateEventKind'], session?: number | null }} one */
export const eventText = ({ event, session }) => words.events[event](session);

/**
 * Issues a certificate in the language that staff choose. `issue(values)` asks the service. If only this computer or
 * network can open the address that the certificate would have for ever, staff confirm that first.
 *
 * @param {Props} props
 */
export function IssueForm({ issue, onIssued, onCancel }) {
  const fields = [{ name: 'language', label: words.language, type: 'select', value: words.pageLanguage, options: Object.entries(words.languages) }];
  const [localAddress, setLocalAddress] = useState(null);
  const save = async values => {
    try {
      onIssued(await issue({ ...values, accept_local_address: localAddress !== null }));
    } catch (error) {
      const { local_address: address } = asProblem(error);
      if (!address) throw error;
      setLocalAddress(address);
    }
  };
  return html`
    <p>${words.issueBody}</p>
    ${localAddress && html`<${Notice} tone="warn" title=${words.localAddress(localAddress)}>${words.localAddressBody}<//>`}
    <${Form} fields=${fields} submit=${localAddress ? words.issueAllTheSame : words.issue} onSave=${save} onCancel=${onCancel} />`;
}

/** What staff see above the sheet. @param {Props} props */
export function IssueNotice({ trainee, task, onIssued }) {
  const [dialog, setDialog] = useState(false);
  const close = () => setDialog(false);
  const issue = values => api.certificates.issue(trainee, { task, ...values });
  return html`
    <${Notice} tone="busy" title=${words.notIssued}>${words.notIssuedBody}<//>
    <p><button class="button main" type="button" onClick=${() => setDialog(true)}>${words.issue}</button></p>
    ${dialog && html`<${Dialog} title=${words.issue} onClose=${close}>
      <${IssueForm} issue=${issue} onIssued=${made => (close(), onIssued(made))} onCancel=${close} />
    <//>`}`;
}
