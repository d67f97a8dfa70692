// Consent to recordings: what holds for a trainee, the text, and the decisions of the trainee or of the staff.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { calendarDay, date, dateTime } from '../../format.js';
import { href } from '../../router.js';
import { language, t } from '../../texts.js';
import { Confirm, Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Loading, Notice, ProblemNotice } from '../page/notice.js';

const words = t.consent;
const TONES = { given: 'good', due: 'warn', missing: 'bad', refused: 'bad', withdrawn: 'bad' };
const LANGUAGES = /** @type {const} */ (['en', 'de']);

/** Whether new recordings of a trainee with this state are refused. */
export const isRefused = state => ['missing', 'refused', 'withdrawn'].includes(state);

/** The state in a few words; nothing where consent is not needed. */
export const ConsentPill = ({ state }) => (TONES[state] ? html`<span class=${`pill ${TONES[state]}`}>${words.states[state]}</span>` : null);

/** In a list: only what staff have to do something about. */
export const LacksConsent = ({ state }) => (state === 'due' || isRefused(state) ? html`<${ConsentPill} state=${state} />` : null);

/** The wording in the page's language, else in the other one, with its language. @param {Schemas['ConsentTextResponse']} text */
export function wordingOf(text) {
  const other = LANGUAGES.find(one => one !== language);
  const own = text[/** @type {'en' | 'de'} */ (language)];
  return own ? { ...own, lang: undefined } : { title: '', body: '', ...(other && text[other]), lang: other };
}

/** A text as trainees read it. @param {Props} props */
export function ConsentWording({ text }) {
  const { title, body, lang } = wordingOf(text);
  return html`<div lang=${lang}><h3>${title}</h3><p class="said">${body}</p></div>`;
}

/** What a person sees before anything else until they have decided; nothing otherwise. @param {Props} props */
export function ConsentAsked({ consent }) {
  if (consent?.state !== 'due' && consent?.state !== 'missing') return null;
  const title = consent.state === 'due' ? words.askedUntil(date(consent.due_at)) : words.asked;
  return html`<${Notice} tone="warn" title=${title}><a href=${href(['account'])}>${words.readText}</a><//>`;
}

/** Why no recording of a chosen trainee can be sent. @param {Props} props */
export const ConsentNotice = ({ trainee, isOwn }) => html`
  <${Notice} tone="bad" title=${words.noRecordings[trainee.consent](trainee.name)}>
    ${isOwn ? html`<a href=${href(['account'])}>${words.readText}</a>` : html`<a href=${href(['trainees', trainee.id])}>${words.toTrainee}</a>`}<//>`;

/** The card on the own account and on the page of a trainee. @param {Props} props */
export function ConsentCard({ trainee, isOwn, mayEdit }) {
  const [dialog, setDialog] = useState(null); // paper, withdrawn or refused
  const [refusal, setRefusal] = useState(null);
  const { data, problem, reload } = useData(async signal => {
    const [texts, consent] = await Promise.all([api.consentTexts.all(signal), api.trainees.consent(trainee, signal)]);
    return { texts, consent };
  }, [trainee]);
  if (data && data.texts.length === 0 && data.consent.history.length === 0) return null;
  const record = decision => api.trainees.recordConsent(trainee, decision).then(() => (setRefusal(null), reload()));
  const decide = decision => record({ decision, text: data?.texts[0].id }).catch(error => setRefusal(asProblem(error)));
  return html`
    <section class="card consent unprinted" id="consent">
      <header><h2>${words.title}</h2>${data && html`<${ConsentPill} state=${data.consent.state} />`}</header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        <${ProblemNotice} problem=${refusal} onDismiss=${() => setRefusal(null)} />
        ${!data && !problem && html`<${Loading} />`}
        ${data && html`<${State} consent=${data.consent} isOwn=${isOwn} />
          ${isOwn ? html`<${OwnDecision} consent=${data.consent} texts=${data.texts} onDecide=${decide} onWithdraw=${() => setDialog('withdrawn')} />`
            : mayEdit && html`<${StaffDecision} state=${data.consent.state} onAsk=${setDialog} />`}
          <${History} consent=${data.consent} texts=${data.texts} />`}
      </div>
      ${dialog === 'paper' && html`<${PaperDialog} texts=${data?.texts ?? []} onSave=${record} onClose=${() => setDialog(null)} />`}
      ${(dialog === 'withdrawn' || dialog === 'refused') && html`<${Confirm} title=${words.confirm[dialog]} body=${`${words.confirmBody} ${isOwn ? words.eraseOwn : words.eraseTrainee}`}
        yes=${words.confirm[dialog]} onYes=${() => record(dialog === 'withdrawn' ? { decision: 'withdrawn' } : { decision: 'refused', text: data?.texts[0].id })}
        onClose=${() => setDialog(null)} />`}
    </section>`;
}

/** What holds now, in a sentence. @param {Props} props */
function State({ consent, isOwn }) {
  const { state, due_at: dueAt } = consent;
  const sentence = isOwn ? words.own[state] : words.of[state];
  return html`<p>${typeof sentence === 'function' ? sentence(date(dueAt)) : sentence}</p>
    ${isRefused(state) && state !== 'missing' && html`<p class="small muted">${isOwn ? words.eraseOwn : words.eraseTrainee}</p>`}`;
}

/** The text and the two buttons, alike so that neither is suggested, or a button to withdraw. @param {Props} props */
function OwnDecision({ consent, texts, onDecide, onWithdraw }) {
  const newest = texts[0];
  const given = consent.history[0]?.decision === 'given' ? consent.history[0] : null;
  const isOpen = newest && (!given || given.version < newest.version);
  return html`
    ${isOpen && html`
      <div class="consent-text"><${ConsentWording} text=${newest} /></div>
      ${given && html`<p class="small muted">${words.newer(newest.version, given.version)}</p>`}
      <div class="actions row">
        ${!given && consent.state !== 'refused' && consent.state !== 'withdrawn' && html`<button class="button" type="button"
          onClick=${() => onDecide('refused')}>${words.refuse}</button>`}
        <button class="button" type="button" onClick=${() => onDecide('given')}>${words.consent}</button>
      </div>`}
    ${given && html`<p><button class="button" type="button" onClick=${onWithdraw}>${words.withdraw}</button></p>`}`;
}

/** @param {Props} props */
const StaffDecision = ({ state, onAsk }) => html`
  <p class="row">
    <button class="button" type="button" onClick=${() => onAsk('paper')}>${words.paper}</button>
    ${(state === 'given' || state === 'due') && html`<button class="button bare" type="button" onClick=${() => onAsk('withdrawn')}>${words.recordWithdrawal}</button>`}
    ${(state === 'missing' || state === 'not_needed') && html`<button class="button bare" type="button" onClick=${() => onAsk('refused')}>${words.recordRefusal}</button>`}
  </p>`;

/** @param {Props} props */
function PaperDialog({ texts, onSave, onClose }) {
  const fields = [
    { name: 'text', label: words.version, type: 'select', value: texts[0]?.id, options: texts.map(text => [text.id, words.versionOf(text.version, wordingOf(text).title)]) },
    { name: 'signed_on', label: words.signedOn, hint: words.signedOnHint, type: 'date', required: true, max: new Date().toISOString().slice(0, 10) },
  ];
  const save = async values => {
    await onSave({ decision: 'given', ...values });
    onClose();
  };
  return html`
    <${Dialog} title=${words.paper} onClose=${onClose}>
      <p>${words.paperBody}</p>
      <${Form} fields=${fields} submit=${words.recordPaper} onSave=${save} onCancel=${onClose} />
    <//>`;
}

/** All decisions, and the texts that they are about. @param {Props} props */
function History({ consent, texts }) {
  if (!consent.history.length) return null;
  const decided = texts.filter(text => consent.history.some(entry => entry.text === text.id));
  return html`
    <details>
      <summary>${words.history(consent.history.length)}</summary>
      <ul class="edit-list">${consent.history.map(entry => html`
        <li key=${entry.id}><div><strong>${words.decisions[entry.decision]} · ${words.versionNumber(entry.version)}</strong>
          <p class="small muted">${howText(entry)}</p></div></li>`)}</ul>
      ${decided.map(text => html`<details key=${text.id}><summary>${words.versionOf(text.version, wordingOf(text).title)}</summary>
        <${ConsentWording} text=${text} /></details>`)}
    </details>`;
}

/** @param {Schemas['ConsentEntry']} entry */
function howText({ how, who, created_at: at, signed_on: day }) {
  const name = who ?? t.session.edits.gone;
  if (how === 'paper') return words.onPaper(calendarDay(day), name, dateTime(at));
  return how === 'staff' ? words.byStaff(name, dateTime(at)) : words.signedIn(name, dateTime(at));
}
