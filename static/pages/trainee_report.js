// A trainee on one sheet of paper: progress at a task, judged by its standard, over the sessions.
import { html } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { date } from '../format.js';
import { t } from '../texts.js';
import { featureWithTool } from '../translate.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { ProgressPlot } from '../parts/charts/progress_plot.js';
import { ProgressSummary } from '../parts/people/progress_summary.js';
import { Facts, limitWithUnit, measuredText, Provenance, reference, Sheet } from '../parts/page/report.js';

const words = t.report;
const MAX_SESSIONS = 14; // The last ones; the sheet says how many came before.
const MAX_FEATURES = 3;

/** @param {Props} props */
export default function TraineeReport({ route }) {
  const { id } = route.params;
  const query = { task: route.query.get('task') ?? undefined, cohort: route.query.get('cohort') ?? undefined };
  const { data, problem, reload } = useData(
    signal => api.trainees.progress(id, query, signal), [id, query.task, query.cohort]);
  if (!data)
    return html`<${PageHead} title=${words.traineeTitle} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  if (!data.task || !data.sessions.length)
    return html`<${PageHead} title=${words.traineeTitle} /><${Empty} title=${t.trainee.none} body=${t.trainee.noneBody} />`;
  const { trainee, task, sessions } = data;
  const series = data.features.slice(0, MAX_FEATURES);
  const counted = sessions.filter(one => !one.set_aside).length;
  return html`
    <${Sheet} title=${words.progressOf(task.name)} back=${['trainees', id]}>
      <${Facts} rows=${[
        [words.trainee, `${trainee.name} (${trainee.code})`],
        [words.level, trainee.level && t.trainees.levels[trainee.level]],
        [words.task, task.name],
        [words.period, [...new Set([sessions[0], sessions[sessions.length - 1]].map(one => date(one.recorded_at)))].join(' – ')],
        [words.sessions, words.counted(data.earlier + sessions.length, counted)],
      ]} />
      <section class=${data.cohort ? 'words' : 'words alone'}>${series[0] && html`<${ProgressSummary} progress=${data} series=${series[0]} />`}</section>
      <${Curves} series=${series} sessions=${sessions} />
      <${Sessions} sessions=${sessions} series=${series} earlier=${data.earlier} />
      <${Provenance} rows=${[
        [words.program, data.pipeline],
        [words.standard, data.standard ? words.versionOf(data.standard.version) : words.noStandard],
        [words.cohort, data.cohort && words.people(data.cohort.name, data.cohort.people)],
        [words.taskId, task.code],
        [words.reference, reference(trainee.id)],
      ]} />
    <//>`;
}

/** @param {Props} props */
const Curves = ({ series, sessions }) => series.some(one => one.points.some(point => point.value !== null)) && html`
  <section class=${`curve curves-${series.length}`}>
    <h2>${words.curves}</h2>
    <div>${series.map(one => html`<figure key=${`${one.feature} ${one.tool} ${one.space}`}>
      <figcaption>${featureWithTool(one)}${one.target ? `: ${limitWithUnit(one.target, one.unit)}` : ''}</figcaption>
      <${ProgressPlot} series=${one} sessions=${sessions} /></figure>`)}</div>
    <p>${series.some(one => one.target) ? t.trainee.legend : words.noLimit}</p>
  </section>`;

/** @param {Props} props */
function Sessions({ sessions, series, earlier }) {
  const last = sessions.slice(-MAX_SESSIONS);
  const before = earlier + sessions.length - last.length;
  const at = (one, session) => one.points.find(point => point.session === session.number);
  return html`
    <section>
      <h2>${words.sessionsTable}</h2>
      <table>
        <thead><tr><th scope="col">${words.number}</th><th scope="col">${words.recorded}</th>
          ${series.map(one => html`<th key=${featureWithTool(one)} scope="col">${featureWithTool(one)}</th>`)}
          <th scope="col">${words.judgement}</th><th scope="col">${t.certificate.supervised}</th></tr></thead>
        <tbody>${last.map(session => html`
          <tr key=${session.id}><th scope="row">${session.number}</th><td>${date(session.recorded_at)}${!session.date_known && ` ${t.certificate.claimed}`}</td>
            ${series.map(one => html`<td key=${featureWithTool(one)}>${valueAt(at(one, session), one)}</td>`)}
            <td>${t.trainee.setAside[session.set_aside ?? ''] ?? words.trials[session.trial ?? ''] ?? '–'}</td>
            <td>${t.certificate.supervision[session.supervision ?? 'unknown']}</td></tr>`)}</tbody>
      </table>
      ${last.some(session => !session.date_known) && html`<p>${t.certificate.claimedNote}</p>`}
      ${before > 0 && html`<p>${words.before(before)}</p>`}
    </section>`;
}

function valueAt(point, { unit }) {
  if (!point || point.value === null) return '–';
  const error = point.low === null ? null : { low: point.low, high: point.high };
  return measuredText({ value: point.value, error, unit, is_lower_bound: point.is_lower_bound });
}
