// The texts that trainees consent to: all published versions, and publishing the next one. For administrators.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { calendarDay, dateTime } from '../format.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Dialog } from '../parts/forms/dialog.js';
import { Form } from '../parts/forms/form.js';
import { wordingOf } from '../parts/people/consent.js';
import { Empty, Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.consentTexts;
/** Days that trainees have to decide, if nothing else is chosen. */
const GRACE_DAYS = 14;

/** The day in so many days, on this device's calendar, as a date field has it. */
function dayIn(days) {
  const then = new Date();
  then.setDate(then.getDate() + days);
  return [then.getFullYear(), then.getMonth() + 1, then.getDate()].map(part => String(part).padStart(2, '0')).join('-');
}

export default function ConsentTexts() {
  const [isWriting, setWriting] = useState(false);
  const [dating, setDating] = useState(null); // the version whose day changes
  const { data, problem, reload } = useData(signal => api.consentTexts.all(signal), []);
  const done = () => (setWriting(false), setDating(null), reload());
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>
      <a class="button" href=${href(['people'])}>${t.nav.people}</a>
      ${data && html`<button class="button main" type="button" onClick=${() => setWriting(true)}>${words.write}</button>`}
    <//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!data && !problem && html`<${Loading} />`}
    ${data?.length === 0 && html`<section class="card"><${Empty} title=${words.none} body=${words.noneBody} /></section>`}
    <div class="stack">${data?.map(text => html`<${Version} key=${text.id} text=${text} onChangeDay=${() => setDating(text)} />`)}</div>
    ${isWriting && html`<${PublishDialog} newest=${data?.[0]} onDone=${done} onClose=${() => setWriting(false)} />`}
    ${dating && html`<${DayDialog} text=${dating} onDone=${done} onClose=${() => setDating(null)} />`}`;
}

/** @param {Props} props */
function Version({ text, onChangeDay }) {
  const isRequired = text.required_from && text.required_from <= dayIn(0);
  return html`
    <section class="card">
      <header><h2>${t.consent.versionOf(text.version, wordingOf(text).title)}</h2>
        <span class=${`pill ${isRequired ? 'good' : text.required_from ? 'warn' : ''}`}>${isRequired ? words.requiredSince(calendarDay(text.required_from))
          : text.required_from ? words.requiredFrom(calendarDay(text.required_from)) : words.offered}</span></header>
      <div class="body stack">
        <p class="small muted">${words.published(text.who ?? t.session.edits.gone, dateTime(text.published_at))}</p>
        <details><summary>${words.read}</summary><div class="consent-text"><${Wordings} text=${text} /></div></details>
        <p><button class="button" type="button" onClick=${onChangeDay}>${words.changeDay}</button></p>
      </div>
    </section>`;
}

/** Both languages. @param {Props} props */
const Wordings = ({ text }) => html`
  ${text.en && html`<div lang="en"><h3>${text.en.title}</h3><p class="said">${text.en.body}</p></div>`}
  ${text.de && html`<div lang="de"><h3>${text.de.title}</h3><p class="said">${text.de.body}</p></div>`}`;

const dayFields = (value, day) => [
  { name: 'required', label: words.when, type: 'select', value, options: [['day', words.whenDay], ['never', words.whenNever]] },
  { name: 'day', label: words.day, hint: words.dayHint, type: 'date', required: true, value: day, when: chosen => chosen.required === 'day' },
];

/** What requiring a text from a day on does to the trainees. @param {Props} props */
function Effect({ effect, day }) {
  if (!day) return html`<${Notice} tone="good" title=${words.noEffect} />`;
  const { trainees, without_consent: without, active_without_consent: active, without_account: paper } = effect;
  return html`
    <${Notice} tone=${without ? 'warn' : 'good'} title=${words.touches(without, trainees)}>
      ${without > 0 && html`${day <= dayIn(0) ? words.stopsNow : words.stopsOn(calendarDay(day))} ${words.active(active)} ${paper > 0 && words.onPaper(paper)}`}
    <//>`;
}

/** Write, then look at the text and at the trainees that it touches, then publish. @param {Props} props */
function PublishDialog({ newest, onDone, onClose }) {
  const [draft, setDraft] = useState(null); // { en, de, required_from, effect }
  const first = draft ?? newest ?? {};
  const text = (name, label, type, value) => ({ name, label, type, value, maxlength: type === 'textarea' ? 9500 : 120, wide: true, rows: type === 'textarea' ? 8 : undefined });
  const fields = [
    text('title_en', words.titleEn, 'text', first.en?.title), text('body_en', words.bodyEn, 'textarea', first.en?.body),
    text('title_de', words.titleDe, 'text', first.de?.title), text('body_de', words.bodyDe, 'textarea', first.de?.body),
    ...dayFields(draft && !draft.required_from ? 'never' : 'day', draft?.required_from ?? dayIn(GRACE_DAYS)),
  ];
  const look = async values => {
    const wording = lang => (values[`title_${lang}`] || values[`body_${lang}`] ? { title: values[`title_${lang}`] ?? '', body: values[`body_${lang}`] ?? '' } : null);
    const effect = await api.consentTexts.effect();
    setDraft({ en: wording('en'), de: wording('de'), required_from: values.day ?? null, effect, isSeen: true });
  };
  const publish = () => api.consentTexts.publish({ en: draft.en, de: draft.de, required_from: draft.required_from }).then(onDone);
  if (draft?.isSeen)
    return html`
      <${Dialog} title=${words.publishTitle} onClose=${onClose}>
        <${Effect} effect=${draft.effect} day=${draft.required_from} />
        <div class="consent-text"><${Wordings} text=${draft} /></div>
        <p class="small muted">${words.neverChanges}</p>
        <${Form} key="publish" fields=${[]} onSave=${publish} onCancel=${() => setDraft({ ...draft, isSeen: false })} cancel=${words.back} submit=${words.publish} />
      <//>`;
  return html`
    <${Dialog} title=${words.write} onClose=${onClose}>
      <p class="small muted">${words.writeBody}</p>
      <${Form} key="write" fields=${fields} onSave=${look} onCancel=${onClose} submit=${words.look} />
    <//>`;
}

/** Changes when a version becomes required. @param {Props} props */
function DayDialog({ text, onDone, onClose }) {
  const [asked, setAsked] = useState(null); // { day, effect }
  const look = async ({ day = null }) => setAsked({ day, effect: await api.consentTexts.effect(text.id) });
  if (asked)
    return html`
      <${Dialog} title=${words.changeDay} onClose=${onClose}>
        <${Effect} effect=${asked.effect} day=${asked.day} />
        <${Form} key="save" fields=${[]} onSave=${() => api.consentTexts.change(text.id, { required_from: asked.day }).then(onDone)}
          onCancel=${() => setAsked(null)} cancel=${words.back} />
      <//>`;
  return html`
    <${Dialog} title=${words.changeDay} onClose=${onClose}>
      <${Form} key="look" fields=${dayFields(text.required_from ? 'day' : 'never', text.required_from ?? dayIn(GRACE_DAYS))} onSave=${look}
        onCancel=${onClose} submit=${words.look} />
    <//>`;
}
