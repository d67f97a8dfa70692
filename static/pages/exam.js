// One exam: staff start it, record its attempts and close it; the candidate sees the result when it is closed.
import { html, useEffect, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { calendarDay, date, dateTime } from '../format.js';
import { useLive } from '../live.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Attempts } from '../parts/exams/attempts.js';
import { ExamPill } from '../parts/exams/exam_list.js';
import { Confirm, Dialog } from '../parts/forms/dialog.js';
import { Form } from '../parts/forms/form.js';
import { Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { CertificatesCard, IssueForm } from '../parts/people/certificates.js';

const words = t.exams;
const POLL_MS = 2_000;
const COMPLETIONS = /** @type {const} */ (['completed', 'broken_off']);
const IDENTITIES = /** @type {const} */ (['badge', 'document', 'known']);

/** @param {Props} props */
export default function Exam({ person, route }) {
  const { id } = route.params;
  const { data: exam, problem, reload } = useData(signal => api.exams.get(id, signal), [id]);
  const [voiding, setVoiding] = useState(null);
  useLive('session', () => reload());
  useEffect(() => {
    if (exam?.state !== 'running') return undefined;
    const timer = setInterval(reload, POLL_MS); // A recording that begins at the box is no event of this page.
    return () => clearInterval(timer);
  }, [exam?.state]);
  if (!exam)
    return html`<${PageHead} title=${words.title} />${problem ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const isStaff = may(person, 'edit_trainees');
  const mayVoid = may(person, 'people') && exam.state === 'running';
  return html`
    <${PageHead} title=${words.of(exam.trainee.name, exam.task.name)} lead=${html`<a href=${href(['exams'])}>${words.title}</a>`}><${ExamPill} exam=${exam} /><//>
    <div class="stack">
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!isStaff && exam.state === 'running' && html`<${Notice} tone="busy" title=${words.sealed}>${words.sealedBody}<//>`}
      ${exam.result && html`<${Notice} tone=${{ passed: 'good', not_passed: 'bad', undecided: 'warn' }[exam.result]} title=${words.results[exam.result]}>${words.resultBodies[exam.result]}<//>`}
      <section class="card"><header><h2>${words.fixed}</h2></header><div class="body"><dl class="facts">${factsOf(exam).filter(([, value]) => value).map(([name, value]) => html`
        <dt>${name}</dt><dd>${value}</dd>`)}</dl></div></section>
      ${isStaff && exam.state === 'planned' && html`<${Start} exam=${exam} onChange=${reload} />`}
      ${isStaff && exam.state === 'running' && html`<${Run} exam=${exam} onChange=${reload} />`}
      ${exam.state !== 'planned' && html`<${Attempts} exam=${exam} onVoid=${mayVoid ? setVoiding : null} withAdvice=${isStaff && exam.state === 'running'} />`}
      ${isStaff && exam.result === 'passed' && html`<${Certify} exam=${exam} person=${person} />`}
    </div>
    ${voiding && html`<${VoidDialog} exam=${exam} attempt=${voiding} onDone=${() => (setVoiding(null), reload())} onClose=${() => setVoiding(null)} />`}`;
}

const factsOf = exam => [
  [t.target.trainee, html`<a href=${href(['trainees', exam.trainee.id])}>${exam.trainee.name}</a>`],
  [t.target.task, exam.task.name],
  [t.target.box, exam.box.name],
  [words.standard, words.version(exam.standard_version)],
  [words.allowed, exam.attempts_allowed],
  [words.day, exam.day && calendarDay(exam.day)],
  [words.planned, [date(exam.planned_at), exam.planned_by].filter(Boolean).join(', ')],
  [words.examiner, exam.examiner],
  [words.identity, exam.identity && words.identities[exam.identity]],
  [words.started, exam.started_at && dateTime(exam.started_at)],
  [exam.state === 'cancelled' ? words.cancelled : words.closed, exam.ended_at && [dateTime(exam.ended_at), exam.ended_by].filter(Boolean).join(', ')],
];

/** @param {Props} props */
function Start({ exam, onChange }) {
  const { box_check: check } = exam;
  const fields = [{ name: 'identity', label: words.identity, type: 'select', required: true, value: '', options: [['', t.target.choose], ...IDENTITIES.map(one => [one, words.identities[one]])], hint: words.identityHint, wide: true }];
  const save = ({ identity }) => api.exams.start(exam.id, { identity }).then(onChange);
  return html`
    <section class="card">
      <header><h2>${words.start}</h2></header>
      <div class="body stack">
        <${BoxNotReady} exam=${exam} />
        ${exam.day && exam.day !== today() && html`<${Notice} tone="warn" title=${words.otherDay(calendarDay(exam.day))}>${words.otherDayBody}<//>`}
        ${check?.is_ready && html`<${Notice} tone="good" title=${words.boxReady}>${words.testedAt(dateTime(check.tested_at))}<//>
          <p>${words.startBody}</p><${Form} fields=${fields} submit=${words.start} onSave=${save} />`}
        <${CancelButton} exam=${exam} onChange=${onChange} />
      </div>
    </section>`;
}

/** Why the box cannot be used now. @param {Props} props */
const BoxNotReady = ({ exam }) => exam.box_check && !exam.box_check.is_ready && html`
  <${Notice} tone="warn" title=${words.boxNotReady}>
    ${exam.box_check.problems.map(one => words.boxProblems[one]).join(' ')}
    <span class="row after"><a class="button" href=${href(['boxes', exam.box.id])}>${words.toSelfTest(exam.box.name)}</a></span><//>`;

/** Today as `YYYY-MM-DD`. */
const today = () => {
  const now = new Date();
  return [now.getFullYear(), now.getMonth() + 1, now.getDate()].map(part => String(part).padStart(2, '0')).join('-');
};

/** @param {Props} props */
function CancelButton({ exam, onChange }) {
  const [asking, setAsking] = useState(false);
  return html`
    <p><button class="button" type="button" onClick=${() => setAsking(true)}>${words.cancel}</button></p>
    ${asking && html`<${Confirm} title=${words.cancelTitle} body=${words.cancelBody} yes=${words.cancel} no=${words.keep}
      onYes=${() => api.exams.cancel(exam.id).then(onChange)} onClose=${() => setAsking(false)} />`}`;
}

/** @param {Props} props */
function Run({ exam, onChange }) {
  const [problem, setProblem] = useState(null);
  const [isBusy, setBusy] = useState(false);
  const [closing, setClosing] = useState(false);
  const isRecording = exam.attempts.some(attempt => attempt.state === 'recording');
  const counting = exam.attempts.filter(attempt => !attempt.voided_at);
  const isOpen = counting.some(attempt => !attempt.outcome || !attempt.completion);
  const isReady = exam.box_check?.is_ready;
  const left = exam.attempts_allowed - exam.attempts_used;
  const next = exam.attempts.length + 1;
  const voided = exam.attempts.filter(attempt => attempt.voided_at).map(attempt => attempt.number);
  const act = async request => {
    setBusy(true);
    setProblem(null);
    await request().then(onChange, error => setProblem(asProblem(error)));
    setBusy(false);
  };
  return html`
    <section class="card">
      <header><h2>${words.running}</h2></header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
        <p>${isRecording ? words.isRecording : left > 0 ? words.left(left) : words.noneLeft}${voided.length > 0 && ` ${words.givenBack(voided)}`}</p>
        ${exam.waiting.map(one => html`<p key=${one.ordered_at} class="small">${words.waiting(dateTime(one.ordered_at), one.is_recording, one.may_begin)}</p>`)}
        ${!isRecording && left > 0 && html`<${BoxNotReady} exam=${exam} />`}
        ${counting.filter(attempt => attempt.state !== 'recording').map(attempt => html`<fieldset key=${attempt.number} class="plain stack tight"><legend>${words.wasCompleted(attempt.number)}</legend>
          <p class="small muted">${words.wasCompletedHint}</p>
          <p class="row">${COMPLETIONS.map(completion => html`
            <button key=${completion} class="button" type="button" aria-pressed=${attempt.completion === completion} disabled=${isBusy} onClick=${() => act(() => api.exams.setCompletion(exam.id, attempt.number, { completion }))}>${words.completionChoices[completion]}</button>`)}</p></fieldset>`)}
        <p class="row">
          ${(isRecording || exam.waiting.some(one => one.is_recording)) && exam.has_agent && html`<button class="button main" type="button" disabled=${isBusy} onClick=${() => act(() => api.boxes.stop(exam.box.id))}>${words.stopBox}</button>`}
          ${!isRecording && left > 0 && isReady && html`
            ${exam.has_agent && html`<button class="button main" type="button" disabled=${isBusy} onClick=${() => act(() => api.exams.record(exam.id, { way: 'agent' }))}>${words.recordAtBox(next)}</button>`}
            <a class=${`button ${exam.has_agent ? '' : 'main'}`} href=${href(['record'], { exam: exam.id })}>${words.recordHere(next)}</a>`}
          ${exam.attempts_used > 0 && html`<button class="button" type="button" disabled=${isOpen || !exam.result_if_closed} onClick=${() => setClosing(true)}>${words.close}</button>`}
        </p>
        ${exam.result_if_closed && html`<p>${words.ifClosed(words.results[exam.result_if_closed])}</p>`}
        ${exam.attempts_used > 0 && isOpen && !isRecording && html`<p class="small muted">${words.closeLater}</p>`}
        ${exam.attempts_used === 0 && !isRecording && html`<${CancelButton} exam=${exam} onChange=${onChange} />`}
      </div>
    </section>
    ${closing && html`<${Confirm} title=${words.closeTitle} body=${[exam.result_if_closed && words.ifClosed(words.results[exam.result_if_closed]), words.closeBody, left > 0 && words.closeLeft(left)].filter(Boolean).join(' ')} yes=${words.close} no=${words.notYet}
      onYes=${() => api.exams.close(exam.id, exam.result_if_closed).then(onChange, error => { onChange(); throw error; })} onClose=${() => setClosing(false)} />`}`;
}

/** @param {Props} props */
function VoidDialog({ exam, attempt, onDone, onClose }) {
  const fields = [{ name: 'reason', label: words.failure, hint: words.failureHint, type: 'textarea', required: true, maxlength: 2000, wide: true, rows: 3 }];
  const save = ({ reason }) => api.exams.void(exam.id, attempt.number, { reason }).then(onDone);
  return html`
    <${Dialog} title=${words.voidTitle(attempt.number)} onClose=${onClose}>
      <p>${words.voidBody}</p>
      <${Form} fields=${fields} submit=${words.void} onSave=${save} onCancel=${onClose} />
    <//>`;
}

/** Issues the certificate of the exam, and lists those of the candidate. @param {Props} props */
function Certify({ exam, person }) {
  const [issued, setIssued] = useState(0);
  const issue = values => api.exams.certify(exam.id, values);
  return html`
    <section class="card"><header><h2>${t.certificates.issue}</h2></header>
      <div class="body stack"><${IssueForm} key=${issued} issue=${issue} onIssued=${() => setIssued(issued + 1)} /></div></section>
    <${CertificatesCard} key=${issued} trainee=${exam.trainee.id} person=${person} />`;
}
