// One trainee: a feature over the sessions of a task, what the task's standard makes of them, and the sessions.
import { html } from '../parts/preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { dateTime } from '../format.js';
import { useLive } from '../live.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { Balance } from '../parts/balance.js';
import { Field } from '../parts/form.js';
import { MonitorCharts } from '../parts/monitor_chart.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/notice.js';
import { OwnCourses } from '../parts/own_courses.js';
import { ProgressPlot } from '../parts/progress_plot.js';
import { ProgressWords } from '../parts/progress_words.js';
import { StatusPill } from '../parts/status.js';

const words = t.trainee;
const NOBODY = '-'; // No cohort, in the address.

export default function Trainee({ route }) {
  const id = route.path[1];
  const {
    data: base,
    problem,
    reload,
  } = useData(
    async signal => {
      const newest = api.sessions.page({ trainee: id, limit: 1 }, signal);
      const [trainee, tasks, last, features, cohorts, courses] = await Promise.all([
        api.trainees.get(id, signal), api.tasks.all(), newest, api.features(signal), api.cohorts.all(), api.trainees.courses(id, signal)]);
      return { trainee, tasks, features, cohorts, courses, usual: tasks.find(task => task.id === last.items[0]?.task?.id) ?? tasks[0] }; // What they trained last.
    },
    [id],
  );
  if (!base)
    return html`<${PageHead} title=${t.nav.trainees} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const { trainee, tasks } = base;
  const level = t.trainees.levels[trainee.level];
  return html`
    <${PageHead} title=${trainee.name} lead=${[trainee.code, level].filter(Boolean).join(' · ')}>
      <a class="button" href=${href(['trainees', id, 'certificate'], { task: route.query.get('task') ?? base.usual?.id })}>${t.certificate.open}</a>
      <a class="button" href=${href(['trainees', id, 'report'], { task: route.query.get('task'), cohort: cohortOf(route) })}>${t.report.open}</a><//>
    <div class="stack">
      <${OwnCourses} trainee=${id} first=${base.courses} />
      <div>${tasks.length ? html`<${Progress} id=${id} base=${base} route=${route} />`
        : html`<${Empty} title=${words.noTasks} body=${words.noTasksBody} />`}</div>
    </div>`;
}

function Progress({ id, base, route }) {
  const { tasks, features, cohorts, usual } = base;
  const named = key => route.query.get(key) ?? undefined;
  const task = tasks.find(one => one.id === named('task') || one.code === named('task')) ?? usual;
  const asked = { task: task.id, feature: named('feature'), cohort: named('cohort') ?? cohorts[0]?.code };
  if (asked.cohort === NOBODY) delete asked.cohort;
  const { current: data, problem, reload } = useData(
    signal => api.trainees.progress(id, asked, signal),
    [id, asked.task, asked.feature, asked.cohort],
  );
  const soon = useThrottled(reload, 2000);
  useLive('session', event => event.status === 'done' && soon());
  useLive('resync', soon);

  const all = data?.features ?? [];
  const series = all.find(one => keyOf(one) === named('series')) ?? all[0];
  const set = (key, value) => {
    const now = { task: task.id, feature: named('feature'), cohort: named('cohort'), series: named('series') };
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
        ${choose(words.feature, 'feature', named('feature'), [['', words.asked], ...features.map(one => [one.name, one.title])])}
        ${all.length > 1 && choose(words.series, 'series', keyOf(series), all.map(one => [keyOf(one), nameOf(one)]))}
        ${cohorts.length > 0 && choose(words.cohort, 'cohort', asked.cohort ?? NOBODY,
          [...cohorts.map(one => [one.code, one.name]), [NOBODY, words.nobody]])}
      </div>
      <div class="body">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${!data && !problem && html`<${Loading} />`}
        ${none && html`<${Empty} title=${words.none} body=${words.noneBody}>
          <a class="button main" href=${href(['upload'], { trainee: id, task: task.id })}>${t.today.upload}</a><//>`}
        ${!none && series && html`
          <h3>${nameOf(series)}</h3>
          <${ProgressPlot} series=${series} sessions=${data.sessions} />
          ${series.target && html`<p class="small muted">${words.legend}</p>`}
          <${ProgressWords} progress=${data} series=${series} />`}
      </div>
    </section>
    ${data && !none && html`<div class="stack after">${!asked.feature && html`<${Balance} progress=${data} />`}
      ${data.charts && html`<${MonitorCharts} charts=${data.charts} />`}</div>`}
    ${data?.sessions.length > 0 && html`<${Sessions} sessions=${data.sessions} />`}`;
}

/** The cohort that the address names, if it names one. */
const cohortOf = route => (route.query.get('cohort') === NOBODY ? undefined : route.query.get('cohort'));

/** Which series, in the address. */
const keyOf = one => [one.feature, one.tool ?? '', one.space].join('|');
const nameOf = one => [one.title, one.tool].filter(Boolean).join(', ');

const Sessions = ({ sessions }) => html`
  <section class="card list">
    <header><h2>${words.table}</h2></header>
    <ul class="queue">
      ${[...sessions].reverse().map(session => html`<li key=${session.id}><div>
        <a href=${href(['sessions', session.id])}>${dateTime(session.recorded_at)}</a>
        ${words.setAside[session.set_aside] && html`<span class="small muted">${words.setAside[session.set_aside]}</span>`}</div>
        <${StatusPill} state=${session.set_aside === 'refused' ? 'refused' : session.status} /></li>`)}
    </ul>
  </section>`;
