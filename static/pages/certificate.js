// What a certificate says, as a sheet without a signature, for a trainee who has met a task's standard; staff issue the signed
// certificate here. Otherwise the page says what is missing.
import { html } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { date } from '../format.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { featureWithTool } from '../translate.js';
import { CertificatesCard, IssueNotice } from '../parts/people/certificates.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { Provenance, reference, Sheet } from '../parts/page/report.js';
import { limitText } from '../parts/tasks/standard.js';

const words = t.certificate;

/** @param {Props} props */
export default function Certificate({ person, route }) {
  const { id } = route.params;
  const task = route.query.get('task') ?? undefined;
  const { data, problem, reload } = useData(signal => load(id, task, signal), [id, task]);
  if (!data)
    return html`<${PageHead} title=${words.title} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  if (!data.passed)
    return html`<${PageHead} title=${words.title} lead=${[data.trainee.name, data.task?.name].filter(Boolean).join(', ')} />
      <section class="card"><${Empty} title=${words.refused} body=${whyNot(data)}>
        <a class="button" href=${href(['trainees', id], { task })}>${words.back}</a><//></section>
      <${CertificatesCard} trainee=${data.trainee.id} person=${person} />`;
  const passed = /** @type {PassedProgress & typeof data} */ (data);
  const trainee = passed.trainee.id;
  const isIssued = data.issued.some(one => one.task === passed.task.id && one.state !== 'withdrawn'
    && one.content.standard.version === passed.standard.version);
  return html`
    <div class="report-bar stack">
      ${!isIssued && may(person, 'edit_trainees') && html`<${IssueNotice} trainee=${trainee} task=${passed.task.id} onIssued=${reload} />`}
      <${CertificatesCard} key=${data.issued.length} trainee=${trainee} person=${person} />
    </div>
    <${Paper} progress=${passed} />`;
}

/** The progress, with the version of the standard that was passed in place of the one in use. */
async function load(id, task, signal) {
  const progress = await api.trainees.progress(id, { task }, signal);
  const { items: issued } = await api.certificates.page({ trainee: id, limit: 200 }, signal);
  const { passed, standard } = progress;
  if (!progress.task || !passed || passed.standard === standard?.version) return { ...progress, issued };
  const versions = await api.tasks.standards(progress.task.id, signal);
  return { ...progress, issued, standard: versions.find(one => one.version === passed.standard) };
}

/**
 * Why there is no certificate, and what is missing.
 *
 * @param {Schemas['TraineeProgressResponse']} progress
 */
export function whyNot({ task, standard, sessions, rule, charts }) {
  if (!task || !sessions.length) return words.reasons.none;
  if (!standard) return words.reasons.no_standard;
  if (charts?.standing === 'relapsed') return words.reasons.relapsed;
  if (rule?.state === 'out_of_reach') return words.reasons.out_of_reach;
  if (rule?.state === 'open') return words.reasons.rule(rule.have_in_a_row, rule.in_a_row, rule.have_more, rule.then_more);
  return words.reasons.charts;
}

/** @param {{ progress: PassedProgress }} props */
function Paper({ progress: { trainee, task, standard, sessions, passed, pipeline } }) {
  const countedSessions = sessions.filter(session => passed.sessions.includes(session.number));
  return html`
    <${Sheet} title=${words.of(task.name)} back=${['trainees', trainee.id]} kind="certificate" hint=${t.report.hintOfCertificate} footer=${words.printed}>
      <p>${words.says}</p>
      <p class="who">${trainee.name}</p>
      <p>${words.has(task.name)} ${passed.by === 'rule' && standard.rule ? html`${words.byRule} ${words.rule(standard.rule.in_a_row, standard.rule.then_more, standard.rule.at_most)}.` : words.byCharts}</p>
      <p>${words.on} <strong>${date(passed.at)}</strong>. ${words.standard}: ${words.setOn(standard.version, date(standard.created_at))}.</p>
      <section>
        <h2>${words.targets}</h2>
        <ul>${standard.targets.map(target => html`<li key=${featureWithTool(target)}>${featureWithTool(target)}: ${limitText(target)}</li>`)}</ul>
      </section>
      <section>
        <h2>${words.sessions}</h2>
        <table><thead><tr><th scope="col">${t.report.number}</th><th scope="col">${words.date}</th><th scope="col">${words.result}</th><th scope="col">${words.supervised}</th></tr></thead>
          <tbody>${countedSessions.map(session => html`<tr key=${session.id}><th scope="row">${session.number}</th><td>${date(session.recorded_at)}${
            !session.date_known && html` <span class="claim">${words.claimed}</span>`}</td>
            <td>${t.report.trials[session.trial ?? '']}</td><td>${words.supervision[session.supervision ?? 'unknown']}</td></tr>`)}</tbody></table>
      </section>
      ${countedSessions.some(session => !session.date_known) && html`<p class="small">${words.claimedNote}</p>`}
      <div class="signatures"><div>${words.signature}</div><div>${words.signatureDate}</div></div>
      <${Provenance} rows=${[
        [t.report.program, pipeline],
        [t.report.standard, t.report.versionOf(standard.version)],
        [t.report.traineeId, trainee.code],
        [t.report.taskId, task.code],
        [t.report.reference, `${reference(standard.id)}-${reference(trainee.id)}`],
      ]} />
    <//>`;
}
