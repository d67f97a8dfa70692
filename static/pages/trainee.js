// One trainee: each feature over the sessions of a task, and the sessions.
import { html } from '../parts/preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { dateTime } from '../format.js';
import { useLive } from '../live.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { families, featureRows } from '../parts/features.js';
import { Field } from '../parts/form.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/notice.js';
import { Spark } from '../parts/spark.js';
import { StatusPill } from '../parts/status.js';

const words = t.trainee;
const SHARED = '*'; // Features of both tools together, in the address.

export default function Trainee({ route }) {
  const id = route.path[1];
  const {
    data: base,
    problem,
    reload,
  } = useData(
    async signal => {
      const newest = api.sessions.page({ trainee: id, limit: 1 }, signal);
      const [trainee, tasks, last] = await Promise.all([api.trainees.get(id, signal), api.tasks.all(), newest]);
      return { trainee, tasks, usual: tasks.find(task => task.id === last.items[0]?.task?.id) ?? tasks[0] }; // What they trained last.
    },
    [id],
  );
  if (!base)
    return html`<${PageHead} title=${t.nav.trainees} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const { trainee, tasks, usual } = base;
  const level = t.trainees.levels[trainee.level];
  return html`
    <${PageHead} title=${trainee.name} lead=${[trainee.code, level].filter(Boolean).join(' · ')} />
    ${tasks.length ? html`<${Progress} id=${id} tasks=${tasks} usual=${usual} route=${route} />`
      : html`<${Empty} title=${words.noTasks} body=${words.noTasksBody} />`}`;
}

function Progress({ id, tasks, usual, route }) {
  const task = tasks.find(one => one.id === route.query.get('task') || one.code === route.query.get('task')) ?? usual;
  const { data, problem, reload } = useData(signal => api.trainees.progress(id, task.id, signal), [id, task.id]);
  const soon = useThrottled(reload, 2000);
  useLive('session', event => event.status === 'done' && soon());

  const done = (data?.sessions ?? [])
    .filter(session => session.status === 'done' && session.features?.length)
    .sort((a, b) => Date.parse(a.recorded_at) - Date.parse(b.recorded_at));
  const tools = [...new Set(done.flatMap(session => session.features.map(feature => feature.tool ?? SHARED)))]
    .sort()
    .reverse(); // `*` sorts last.
  const wanted = route.query.get('tool');
  const tool = tools.includes(wanted) ? wanted : tools[0];
  const set = (key, value) => replace(['trainees', id], { task: task.id, tool: wanted, [key]: value });
  return html`
    <section class="card">
      <header><h2>${words.progress}</h2></header>
      <div class="filters">
        <${Field} type="select" label=${words.task} value=${task.id} options=${tasks.map(one => [one.id, one.name])}
          onInput=${event => set('task', event.target.value)} />
        ${tools.length > 0 && html`<${Field} type="select" label=${words.tool} value=${tool}
          options=${tools.map(name => [name, name === SHARED ? t.session.both
          : name])} onInput=${event => set('tool', event.target.value)} />`}
      </div>
      <div class="body">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${!data && !problem && html`<${Loading} />`}
        ${data && done.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody}>
          <a class="button main" href=${href(['upload'], { trainee: id, task: task.id })}>${t.today.upload}</a><//>`}
        ${done.length > 0 && families(sparks(done, tool === SHARED ? null : tool)).map(([family, members]) => html`
          <section key=${family} class="family">
            ${t.session.families[family] && html`<h3>${t.session.families[family]}</h3>`}
            <div class="sparks">${members.map(spark => html`<${Spark} key=${spark.name} ...${spark} />`)}</div>
          </section>`)}
      </div>
    </section>
    ${data?.sessions.length > 0 && html`<${Sessions} sessions=${data.sessions} />`}`;
}

/** One small plot per feature of that tool, with a point per session. */
function sparks(sessions, tool) {
  const rows = sessions.map(session => new Map(spatialRows(session.features).map(row => [row.name, row])));
  const names = new Map();
  for (const row of rows.flatMap(ofSession => [...ofSession.values()]))
    if (row.byTool.has(tool)) names.set(row.name, row);
  return [...names.values()].map(({ name, title, family, unit }) => ({
    name,
    title,
    family,
    unit,
    points: sessions.map(({ id, recorded_at }, index) => {
      return { id, recorded_at, value: rows[index].get(name)?.byTool.get(tool)?.value ?? null };
    }),
  }));
}

/** Features in space; those that are measured in the image alone, there. */
function spatialRows(features) {
  const [inSpace, inImage] = ['3d', 'image'].map(space => featureRows(features, space));
  return [...inSpace, ...inImage.filter(row => !inSpace.some(({ name }) => name === row.name))];
}

const Sessions = ({ sessions }) => html`
  <section class="card list">
    <header><h2>${words.table}</h2></header>
    <ul class="queue">
      ${[...sessions].reverse().map(session => html`<li key=${session.id}><div>
        <a href=${href(['sessions', session.id])}>${dateTime(session.recorded_at)}</a></div>
        <${StatusPill} state=${session.status} /></li>`)}
    </ul>
  </section>`;
