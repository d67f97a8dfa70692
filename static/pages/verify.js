// The public page of a certificate, at the address of its QR code: whether it is valid, and what it says. It also checks a
// file. It needs no sign-in.
import { html, useEffect, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { calendarDay, date } from '../format.js';
import { t } from '../texts.js';
import { eventText } from '../parts/people/certificates.js';
import { CentreMark } from '../parts/page/centre_mark.js';
import { LanguageChoice } from '../parts/page/language.js';
import { Facts } from '../parts/page/report.js';
import { Loading, Notice, ProblemNotice } from '../parts/page/notice.js';

const words = t.verify;
/** Largest file that the service reads, bytes. */
const MAX_BYTES = 2 * 1024 * 1024;

/** `code`: from the address; undefined if it has none. @param {Props} props */
export function PublicCertificate({ code }) {
  const { data, problem, reload } = useData(async signal => (code ? api.certificates.check(code, signal) : null), [code]);
  useEffect(() => {
    document.title = `${words.title} – ${t.product}`;
  }, []);
  const isUnknown = problem?.status === 404;
  return html`
    <main class="gate wide">
      <section class="card">
        <div class="body stack">
          <div class="brand"><${CentreMark} size=${36} /></div>
          <h1>${words.title}</h1>
          ${code && !data && !problem && html`<${Loading} />`}
          ${isUnknown ? html`<${Notice} tone="bad" title=${words.unknown}>${words.unknownBody}<//>`
            : html`<${ProblemNotice} problem=${problem} onRetry=${reload} />`}
          ${data && html`<${State} check=${data} /><${Content} content=${data.content} />`}
          <${FileCheck} shown=${data?.content?.code} />
          <${LanguageChoice} />
        </div>
      </section>
    </main>`;
}

/** @param {Props} props */
function State({ check: { state, state_at: at, reason, marks } }) {
  if (state === 'valid') return html`<${Notice} tone="good" title=${words.valid}>${words.validBody}<//>`;
  if (state === 'withdrawn')
    return html`<${Notice} tone="bad" title=${words.withdrawn(date(at))}>${words.reason} <span class="said">${reason}</span><//>`;
  if (state === 'erased') return html`<${Notice} tone="bad" title=${words.erased(date(at))}>${words.erasedBody}<//>`;
  return html`
    <${Notice} tone="warn" title=${words.review(date(at))}>${words.reviewBody}<//>
    <ul>${marks.map((mark, i) => html`<li key=${i}>${eventText(mark)} (${date(mark.at)})</li>`)}</ul>`;
}

/** What the certificate says, and no more. @param {Props} props */
function Content({ content }) {
  if (!content) return null;
  const { standard, sessions, exam } = content;
  const supervision = session => t.certificate.supervision[session.supervision ?? 'unknown'];
  return html`
    <${Facts} rows=${[
      [words.person, content.trainee],
      [words.task, content.task],
      [words.how, words.basis[content.basis]],
      [words.rule, standard.rule],
      [t.exams.examiner, exam?.examiner],
      [t.exams.identity, exam && t.exams.identities[exam.identity]],
      [t.exams.allowedUsed, exam && t.exams.used(exam.attempts_used, exam.attempts_allowed, exam.voided ?? [])],
      [words.earned, calendarDay(content.earned_on)],
      [words.standard, t.certificate.setOn(standard.version, calendarDay(standard.set_on))],
      [words.issued, `${calendarDay(content.issued_on)}, ${content.issuer}`],
      [words.centre, content.centre],
      [words.program, `${content.program}, ${content.measurement}`],
      [words.key, content.key],
    ]} />
    <h2>${words.limits}</h2>
    <ul lang=${content.language}>${standard.limits.map(limit => html`<li key=${limit}>${limit}</li>`)}</ul>
    <h2>${exam ? t.exams.attempts : t.certificate.sessions}</h2>
    <div class="scroll"><table><thead><tr><th scope="col">${exam ? t.exams.attemptNumber : t.report.number}</th><th scope="col">${t.certificate.date}</th><th scope="col">${t.certificate.supervised}</th></tr></thead>
      <tbody>${sessions.map(session => html`<tr key=${session.number}><th scope="row">${session.number}</th>
        <td>${calendarDay(session.recorded_on)}${!session.day_known && html` <span class="claim">${t.certificate.claimed}</span>`}</td><td>${supervision(session)}</td></tr>`)}</tbody></table></div>`;
}

/** Checks a file that is chosen or dropped. `shown`: the code of the certificate that the page shows already. @param {Props} props */
function FileCheck({ shown }) {
  const [checked, setChecked] = useState(/** @type {{ name: string, answer?: Schemas['FileCheck'], problem?: any, isBusy?: boolean } | null} */ (null));
  const check = async file => {
    if (!file) return;
    if (file.size > MAX_BYTES) return void setChecked({ name: file.name, problem: { title: words.tooLarge, detail: words.tooLargeBody } });
    setChecked({ name: file.name, isBusy: true });
    const pdf = new Blob([file], { type: 'application/pdf' });
    await api.certificates.checkFile(pdf).then(answer => setChecked({ name: file.name, answer }), error => setChecked({ name: file.name, problem: asProblem(error) }));
  };
  const drop = event => {
    event.preventDefault();
    check(event.dataTransfer.files[0]);
  };
  return html`
    <div class="verify-file" onDragOver=${event => event.preventDefault()} onDrop=${drop}>
      <h2>${words.file}</h2>
      <p class="small muted">${words.fileBody}</p>
      <label class="field"><span>${words.choose}</span><input type="file" accept="application/pdf,.pdf" onChange=${event => check(event.target.files[0])} /></label>
      ${checked?.isBusy && html`<${Loading} />`}
      <${ProblemNotice} problem=${checked?.problem} />
      ${checked?.answer && html`<${FileVerdict} name=${checked.name} answer=${checked.answer} shown=${shown} />`}
    </div>`;
}

/** @param {Props} props */
function FileVerdict({ name, shown, answer: { signature, certificate } }) {
  if (signature !== 'genuine') return html`<${Notice} tone="bad" title=${words.signatures[signature]}>${words.signatureBodies[signature](name)}<//>`;
  if (!certificate) return html`<${Notice} tone="bad" title=${words.lost}>${words.lostBody}<//>`;
  const genuine = html`<${Notice} tone="good" title=${words.genuine}>${words.genuineBody(name)}<//>`;
  if (shown && certificate.content?.code === shown) return html`${genuine}<p class="small muted">${words.sameAsAbove}</p>`;
  return html`${genuine}
    <${State} check=${certificate} /><${Content} content=${certificate.content} />`;
}
