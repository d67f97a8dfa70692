// A session on paper: quality, targets, measured values, learning curve, and what people said. One sheet, unless they said
// a lot.
import { html } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { clock } from '../format.js';
import { t } from '../texts.js';
import { featureWithTool, findingText, notEnoughText, toolWithHand } from '../translate.js';
import { featuresIn, firstSpace, isTooUncertain, poorDepthText } from '../parts/session/compared_space.js';
import { featureRows } from '../parts/session/features.js';
import { feedbackLines, loadFeedback, ReportFeedback } from '../parts/session/report_feedback.js';
import { usedVersionText } from '../parts/session/setup_versions.js';
import { leadingReasons } from '../parts/session/verdict.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { ProgressPlot } from '../parts/charts/progress_plot.js';
import { recordedAtText } from '../parts/page/recorded_at.js';
import { Facts, limitWithUnit, measuredText, Provenance, reference, Sheet } from '../parts/page/report.js';

const words = t.report;
const MAX_TARGETS = 10; // Per sheet; the sheet says how many are left out.
const MAX_ROWS = 15; // Both tables together: leaves space for the rest even with the longest texts.
const MAX_REASONS = 3;
const MIN_ROWS = 4; // Other measurements, however much people said.
const NOTE_ROWS = 2; // What the note on poor depth takes.

/** @param {Props} props */
export default function SessionReport({ route }) {
  const { id } = route.params;
  const { data, problem, reload } = useData(
    async signal => {
      const session = await api.sessions.get(id, signal);
      if (session.status !== 'done') return { session, progress: null, feedback: null };
      const judged = session.features.find(feature => feature.target);
      const query = { task: session.task.id, feature: judged?.name ?? 'duration', tool: judged?.tool, space: judged?.space };
      const [progress, feedback] = await Promise.all([
        api.trainees.progress(session.trainee.id, query, signal).catch(() => null), loadFeedback(id, signal)]);
      return { session, progress, feedback };
    },
    [id],
  );
  if (!data)
    return html`<${PageHead} title=${words.session} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const { session, progress, feedback } = data;
  if (session.status !== 'done' || !feedback)
    return html`<${PageHead} title=${words.session} /><${Empty} title=${words.notDone} body=${words.notDoneBody} />`;
  return html`
    <${Sheet} title=${words.sessionOf(session.task.name)} back=${['sessions', id]} hint=${words.hintOfSession}>
      <${Facts} rows=${[
        [words.trainee, `${session.trainee.name} (${session.trainee.code})`],
        [words.task, session.task.name],
        [words.recorded, recordedAtText(session)],
        [words.length, clock(session.video.duration_s)],
        [words.box, session.box.name],
        [words.source, session.source.kind === 'import' ? words.imported(session.source.tracker) : null],
      ]} />
      ${session.box_question === 'asked' && html`<p><strong>${t.session.boxQuestion.title(session.box.name)}</strong>${' '}
        ${t.session.boxQuestion.body(session.box.name)}</p>`}
      <${QualityGate} quality=${session.quality} />
      <${Targets} features=${session.features} />
      <${Values} session=${session} lines=${feedbackLines(feedback)} />
      <${Learning} progress=${progress} session=${session} />
      <${ReportFeedback} feedback=${feedback} />
      <${ReportProvenance} session=${session} progress=${progress} />
    <//>`;
}

/** @param {Props} props */
function QualityGate({ quality }) {
  const verdict = t.session.verdict[quality?.verdict ?? ''];
  if (!verdict) return null;
  const [shown, others] = leadingReasons(quality.reasons ?? [], MAX_REASONS);
  return html`
    <section>
      <h2>${t.session.verdict.name}</h2>
      <p><strong>${verdict}.</strong></p>
      ${shown.length > 0 && html`<ul>
        ${shown.map(one => html`<li key=${`${one.name} ${one.tool}`}>${findingText(one)}.</li>`)}
        ${others.length > 0 && html`<li>${t.session.verdict.more(others.length)}</li>`}</ul>`}
    </section>`;
}

/** The targets of the task, and whether the session met them. */
function Targets({ features }) {
  const judged = features.filter(feature => feature.target);
  if (!judged.length) return html`<section><h2>${words.targets}</h2><p>${words.noStandard}</p></section>`;
  return html`
    <section>
      <h2>${words.targets}</h2>
      <table class="targets">
        <thead><tr><th scope="col">${t.session.feature}</th><th scope="col">${words.target}</th>
          <th scope="col">${words.measured}</th><th scope="col">${words.judgement}</th></tr></thead>
        <tbody>${judged.slice(0, MAX_TARGETS).map(one => html`
          <tr key=${`${one.name} ${one.tool} ${one.space}`}>
            <th scope="row">${featureWithTool(one)}</th>
            <td>${limitWithUnit(one.target, one.unit)}</td>
            <td lang=${notEnoughText(one).lang}>${measuredText(one)}</td>
            <td><strong>${words.judgements[one.judgement]}</strong></td>
          </tr>`)}</tbody>
      </table>
      ${judged.length > MAX_TARGETS && html`<p>${words.further(judged.length - MAX_TARGETS)}</p>`}
    </section>`;
}

/**
 * The other measured values, in space or in the image where depth is poor, as many as fit beside `lines` of feedback. A row
 * has the values of both tools, also of one that has a target, so that they can be compared.
 *
 * @param {Props} props
 */
function Values({ session, lines }) {
  if (session.quality?.verdict === 'refused')
    return html`<section><h2>${t.session.features}</h2><p>${t.session.withheldBody}</p></section>`;
  const space = firstSpace(session);
  const isShown = row => !(space === 'image' && row.needsDepth)
    && [...row.byTool.values()].some(one => !one.target && saysSomething(one));
  const rows = byImportance(featureRows(featuresIn(session.features, space)).filter(isShown));
  const targets = Math.min(MAX_TARGETS, session.features.filter(feature => feature.target).length);
  const note = space === 'image' ? NOTE_ROWS : 0;
  const shown = rows.slice(0, Math.max(MIN_ROWS, MAX_ROWS - note - Math.ceil(1.5 * targets) - lines));
  const columns = [...session.tools, null].filter(tool => shown.some(row => row.byTool.has(tool)));
  if (!shown.length) return null;
  return html`
    <section>
      <h2>${words.further_values}</h2>
      ${space === 'image' && session.compare_in && html`<p>${words.inImage} ${poorDepthText(session.compare_in)}</p>`}
      <table class="values">
        <thead><tr><th scope="col">${t.session.feature}</th>
          ${columns.map(tool => html`<th key=${tool} scope="col">${tool ? toolWithHand(session.features, tool) : words.both}</th>`)}</tr></thead>
        <tbody>${shown.map(row => html`
          <tr key=${row.name}><th scope="row">${row.title}</th>
            ${columns.map(tool => html`<td key=${tool}>${row.byTool.has(tool) ? short(row.byTool.get(tool)) : ''}</td>`)}</tr>`)}
        </tbody>
      </table>
      ${rows.length > shown.length && html`<p>${words.further(rows.length - shown.length)}</p>`}
    </section>`;
}

/** What a person looks at first; the others follow in the order of the service. */
const FIRST_FEATURES = ['duration', 'path_length', 'movements', 'idle_share', 'mean_velocity', 'economy_of_volume', 'economy_of_area',
  'depth_travelled', 'spectral_arc_length', 'together_share', 'tip_distance'];

const byImportance = rows => [
  ...FIRST_FEATURES.flatMap(name => rows.filter(row => row.name === name)),
  ...rows.filter(row => !FIRST_FEATURES.includes(row.name)),
];

/** False without a value, where nothing happened, and where the error is as large as the value. @param {Schemas['FeatureResponse']} one */
const saysSomething = one => one.value !== null && one.value !== 0 && !isTooUncertain(one)
  && !(one.error && (one.error.high - one.error.low) / 2 >= Math.abs(one.value ?? 0));

/** A narrow column does not explain a missing value; the session's page does. */
const short = one => (one.value === null ? t.session.notEnough : measuredText(one));

/** @param {Props} props */
function Learning({ progress, session }) {
  const series = progress?.features[0];
  if (!series?.points.some(point => point.value !== null)) return null;
  const number = progress.sessions.find(one => one.id === session.id)?.number;
  return html`
    <section class="curve">
      <h2>${words.learning(featureWithTool(series))}</h2>
      <${ProgressPlot} series=${series} sessions=${progress.sessions} />
      <p>${number ? words.thisOne(number) : ''} ${series.target ? t.trainee.legend : words.noLimit}</p>
    </section>`;
}

/** @param {{ session: Present<Schemas['SessionResponse'], 'versions'>, progress: Props['progress'] | null }} props */
function ReportProvenance({ session, progress }) {
  const { versions, video, setup } = session;
  return html`<${Provenance} rows=${[
    [words.session, reference(session.id)],
    [words.result, reference(session.result)],
    [words.file, `${session.filename}, ${words.bytes(video.bytes)}`],
    [words.sha256, video.sha256],
    [words.program, [versions.pipeline, versions.tracked_with && words.trackedWith(versions.tracked_with)].filter(Boolean).join(', ')],
    [t.session.version.calibration, [setup && usedVersionText(setup.calibration), reference(versions.calibration)].filter(Boolean).join(', ')],
    [t.session.version.palette, [setup && usedVersionText(setup.palette), reference(versions.palette)].filter(Boolean).join(', ')],
    [t.session.version.model, reference(versions.model)],
    [words.standard, progress?.standard && words.versionOf(progress.standard.version)],
  ]} />`;
}
