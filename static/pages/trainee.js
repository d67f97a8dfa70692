// One trainee: a feature over the sessions of a task, its judgement by the task's standard, and the sessions.
import { html } from '../preact.js';
import { api } from '../api.js';
import { csvTime } from '../csv.js';
import { useData, useThrottled } from '../data.js';
import { dateTime, unit } from '../format.js';
import { useLive } from '../live.js';
import { may } from '../roles.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { featureTitle, featureWithTool } from '../translate.js';
import { AccessEntries } from '../parts/people/access_entries.js';
import { ExamsCard } from '../parts/exams/exam_list.js';
import { CertificatesCard } from '../parts/people/certificates.js';
import { ConsentCard } from '../parts/people/consent.js';
import { ErrorScoreProgress, scoreCells, scoreHeading } from '../parts/people/error_score_progress.js';
import { MergedNotice, RecordMerges } from '../parts/people/record_merges.js';
import { RetentionCard } from '../parts/people/retention.js';
import { StrengthsAndWeaknesses } from '../parts/people/strengths.js';
import { Field } from '../parts/forms/form.js';
import { MonitorCharts } from '../parts/charts/monitor_chart.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { OwnData } from '../parts/people/own_data.js';
import { OwnCourses } from '../parts/courses/own_courses.js';
import { handOrTool } from '../parts/tasks/hand_choice.js';
import { spaceChoices } from '../parts/tasks/space_choice.js';
import { ProgressPlot } from '../parts/charts/progress_plot.js';
import { ProgressSummary } from '../parts/people/progress_summary.js';
import { ArrivalNote } from '../parts/page/recorded_at.js';
import { SaveTable } from '../parts/page/save_table.js';
import { Outcome } from '../parts/page/status.js';

const words = t.trainee;
const NO_COHORT = '-'; // In the address: no cohort.

/** @param {Props} props */
export default function Trainee({ person, route }) {
  const { id } = route.params;
  const {
    data: base,
    problem,
    reload,
  } = useData(
    async signal => {
      const newest = api.sessions.page({ trainee: id, limit: 1 }, signal);
      const [trainee, tasks, last, features, cohorts, courses] = await Promise.all([
        api.trainees.get(id, signal), api.tasks.all(), newest, api.features(signal), api.cohorts.all(), api.trainees.courses(id, signal)]);
      // The task that they trained last.
      return { trainee, tasks, features, cohorts, courses, usual: tasks.find(task => task.id === last.items[0]?.task?.id) ?? tasks[0] };
    },
    [id],
  );
  if (!base)
    return html`<${PageHead} title=${t.nav.trainees} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const { trainee, tasks } = base;
  const level = trainee.level && t.trainees.levels[trainee.level];
  return html`
    <${PageHead} title=${trainee.name} lead=${[trainee.code, level].filter(Boolean).join(' · ')}>
      <a class="button" href=${href(['trainees', id, 'certificate'], { task: route.query.get('task') ?? base.usual?.id })}>${t.certificate.open}</a>
      ${may(person, 'edit_trainees') && html`<a class="button" href=${href(['exams'], { plan: 1, trainee: trainee.id })}>${t.exams.plan}</a>`}
      <a class="button" href=${href(['trainees', id, 'report'], { task: route.query.get('task'), cohort: cohortOf(route) })}>${t.report.open}</a><//>
    <div class="stack">
      <${MergedNotice} record=${trainee} opened=${id} />
      <${OwnCourses} trainee=${id} first=${base.courses} />
      <div>${tasks.length ? html`<${Progress} id=${id} base=${base} route=${route} />`
        : html`<${Empty} title=${words.noTasks} body=${words.noTasksBody} />`}</div>
      ${may(person, 'edit_trainees') && html`<div class="columns"><${ConsentCard} trainee=${trainee.id} mayEdit />
        <${RetentionCard} trainee=${trainee.id} name=${trainee.name} mayEdit /></div>`}
      <${ExamsCard} trainee=${trainee.id} />
      <${CertificatesCard} trainee=${trainee.id} person=${person} />
      <${OwnData} trainee=${id} />
      ${may(person, 'people') && html`<${AccessEntries} trainee=${trainee.id} />
        <${RecordMerges} kind="trainee" record=${trainee} onChange=${reload} />`}
    </div>`;
}

/** @param {Props} props */
function Progress({ id, base, route }) {
  const { tasks, features, cohorts, usual } = base;
  const param = key => route.query.get(key) ?? undefined;
  const task = tasks.find(one => one.id === param('task') || one.code === param('task')) ?? usual;
  const spaces = spaceChoices(features.find(one => one.name === param('feature')));
  const space = spaces.map(([name]) => name).find(name => name === param('space'));
  const query = { task: task.id, feature: param('feature'), space, cohort: param('cohort') ?? cohorts[0]?.code };
  if (query.cohort === NO_COHORT) delete query.cohort;
  const { current: data, problem, reload } = useData(
    signal => api.trainees.progress(id, query, signal),
    [id, query.task, query.feature, query.space, query.cohort],
  );
  const reloadSoon = useThrottled(reload, 2000);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);

  const all = data?.features ?? [];
  const series = all.find(one => seriesKey(one) === param('series')) ?? all[0];
  const set = (key, value) => {
    const now = { task: task.id, feature: param('feature'), space: param('space'), cohort: param('cohort'), series: param('series') };
    replace(['trainees', id], { ...now, [key]: value || undefined });
  };
  const choose = (label, key, value, options) => html`<${Field} type="select" label=${label} value=${value}
    options=${options} onInput=${event => set(key, event.target.value)} />`;
  const none = data && !data.sessions.some(session => !session.set_aside);
  return html`
    <section class="card">
      <header><h2>${words.progress}</h2></header>
      <div class="filters">
        ${choose(words.task, 'task', task.id, tasks.map(one => [one.id, one.name]))}
        ${choose(words.feature, 'feature', param('feature'), [['', words.asked], ...features.map(one => [one.name, featureTitle(one)])])}
        ${spaces.length > 0 && choose(t.standardForm.space, 'space', space ?? spaces[0][0], spaces)}
        ${all.length > 1 && choose(words.series, 'series', seriesKey(series), all.map(one => [seriesKey(one), featureWithTool(one)]))}
        ${cohorts.length > 0 && choose(words.cohort, 'cohort', query.cohort ?? NO_COHORT,
          [...cohorts.map(one => [one.code, one.name]), [NO_COHORT, words.nobody]])}
      </div>
      <div class="body">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${!data && !problem && html`<${Loading} />`}
        ${none && html`<${Empty} title=${words.none} body=${words.noneBody}>
          <a class="button main" href=${href(['upload'], { trainee: id, task: task.id })}>${t.today.upload}</a><//>`}
        ${data && !none && series && html`
          <h3>${featureWithTool(series)}</h3>
          <${ProgressPlot} series=${series} sessions=${data.sessions} />
          ${series.target && html`<p class="small muted">${words.legend}</p>`}
          <${ProgressSummary} progress=${data} series=${series} />
          <${SaveTable} name=${`${base.trainee?.name ?? ''} ${task.name}`} rows=${() => tableRows(data)} />`}
      </div>
    </section>
    ${data && !none && html`<div class="stack after">${!query.feature && html`<${StrengthsAndWeaknesses} progress=${data} />`}
      ${data.charts && html`<${MonitorCharts} charts=${data.charts} />`}
      <${ErrorScoreProgress} progress=${data} /></div>`}
    ${data && data.sessions.length > 0 && html`<${Sessions} trainee=${id} taskId=${task.id} progress=${data} />`}`;
}

/** The cohort that the address names, if any. */
const cohortOf = route => (route.query.get('cohort') === NO_COHORT ? undefined : route.query.get('cohort'));

/** The sessions with the values of all shown features, for a spreadsheet. */
const tableRows = progress => {
  const scores = scoreCells(progress);
  return [
    [t.saveTable.number, t.sessions.recorded, t.outcome.name, ...progress.features.flatMap(one => {
      const name = [featureWithTool(one), unit(one.unit)].filter(Boolean).join(', ');
      return [name, `${name}: ${t.saveTable.low}`, `${name}: ${t.saveTable.high}`];
    }), ...scoreHeading(progress)],
    ...progress.sessions.map(step => [step.number, csvTime(step.recorded_at),
      words.setAside[step.set_aside ?? ''] ?? (step.trial ? t.report.trials[step.trial] : t.status[step.status]),
      ...progress.features.flatMap(one => {
        const point = one.points.find(of => of.session === step.number);
        return [point?.value, point?.low, point?.high];
      }), ...scores(step.number)]),
  ];
};

/** Identifies a series in the address. */
const seriesKey = one => [one.feature, handOrTool(one), one.space].join('|');

const LATEST = 50;
/** Reasons why a session does not count that its outcome does not say. */
const NOTED = ['box_asked', 'other_box', 'other_version'];

/** The latest sessions of the task, with their outcomes. @param {Props} props */
function Sessions({ trainee, taskId, progress }) {
  const { data, problem, reload } = useData(signal => api.sessions.page({ trainee, task: taskId, order: 'recorded', limit: LATEST }, signal), [trainee, taskId, progress]);
  const notes = new Map(progress.sessions.filter(step => NOTED.includes(step.set_aside ?? '')).map(step => [step.id, words.setAside[step.set_aside ?? '']]));
  return html`
    <section class="card list">
      <header><h2>${words.table}</h2>${data?.next && html`<a href=${href(['sessions'], { trainee, task: taskId })}>${t.today.all}</a>`}</header>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      <ul class="queue">
        ${data?.items.map(session => html`<li key=${session.id}><div>
          <a href=${href(['sessions', session.id])}>${dateTime(session.recorded_at)}</a><${ArrivalNote} session=${session} />
          ${session.supervision === 'none' && html` <span class="small muted">${t.background.shortNone}</span>`}
          ${notes.get(session.id) && html`<span class="small muted">${notes.get(session.id)}</span>`}</div>
          <${Outcome} session=${session} /></li>`)}
      </ul>
    </section>`;
}
