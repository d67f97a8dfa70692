// A group's progress at a task: one row per trainee, sorted by name at first; values are shown with their errors.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { useLive } from '../live.js';
import { may } from '../roles.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { featureTitle } from '../translate.js';
import { Field } from '../parts/forms/form.js';
import { GroupCourse } from '../parts/courses/group_course.js';
import { GroupTable } from '../parts/people/group_table.js';
import { handChoices, handOfName, handOrTool, handOrToolQuery } from '../parts/tasks/hand_choice.js';
import { MembersDialog } from '../parts/people/groups_tokens.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.groups;

/** @param {Props} props */
export default function GroupPage({ person, route }) {
  const { id } = route.params;
  const isAdministrator = may(person, 'people');
  const { data: base, problem, reload } = useData(async signal => {
    const [group, tasks, features, plans, people, trainees] = await Promise.all([
      api.groups.get(id, signal), api.tasks.all(), api.features(signal), api.courses.all(), isAdministrator ? api.people.all() : [], api.trainees.all()]);
    return { group, tasks, features, plans, people, trainees };
  }, [id]);
  const [members, setMembers] = useState(false);
  if (!base)
    return html`<${PageHead} title=${words.title} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const { group, tasks, plans } = base;
  const course = html`<${GroupCourse} group=${group} plans=${plans} onChange=${reload} />`;
  return html`
    <${PageHead} title=${group.name} lead=${words.count(group.trainees?.length ?? 0)}>
      <a class="button" href=${href(['groups'])}>${words.all}</a>
      ${isAdministrator && html`<button class="button" type="button" onClick=${() => setMembers(true)}>${words.members}</button>`}
      <a class="button" href=${href(['invite'], { group: id })}>${t.invitations.open}</a>
      <a class="button main" href=${href(['enrol'], { group: group.name })}>${words.enrol}</a>
    <//>
    <div class="stack">
      ${group.course && course}
      ${tasks.length ? html`<${Progress} base=${base} route=${route} key=${group.trainees?.join()} />`
        : html`<${MemberList} base=${base} />`}
      ${!group.course && tasks.length > 0 && course}
    </div>
    ${members && html`<${MembersDialog} group=${group} data=${base} onSaved=${() => (setMembers(false), reload())}
      onClose=${() => setMembers(false)} />`}`;
}

/** Without a task there is no progress to show, but the members are known. @param {Props} props */
function MemberList({ base: { group, trainees } }) {
  const members = trainees.filter(({ id }) => group.trainees?.includes(id));
  return html`
    <section class="card">
      <header><h2>${words.memberList}</h2></header>
      ${members.length === 0 ? html`<${Empty} title=${words.empty} body=${words.emptyBody} />` : html`<ul class="queue">${members.map(one => html`
        <li key=${one.id}><div><a href=${href(['trainees', one.id])}>${one.name}</a></div></li>`)}</ul>`}
      <${Empty} title=${words.noTasks} body=${words.noTasksBody}><a class="button" href=${href(['tasks'])}>${words.toTasks}</a><//>
    </section>`;
}

/** @param {Props} props */
function Progress({ base: { group, tasks, features }, route }) {
  const param = key => route.query.get(key) ?? undefined;
  const task = tasks.find(one => one.id === param('task') || one.code === param('task')) ?? tasks[0];
  const query = { task: task.id, feature: param('feature'), tool: param('tool'), in_hand: handOfName(param('in_hand')) };
  const { data, current, problem, reload } = useData(
    signal => api.groups.progress(group.id, query, signal), [group.id, query.task, query.feature, query.tool, query.in_hand]);
  const feature = features.find(one => one.name === data?.feature);
  const reloadSoon = useThrottled(reload, 3000);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);
  const set = (key, value) => {
    replace(['groups', group.id], { ...query, tool: undefined, in_hand: undefined, [key]: value || undefined });
  };
  // A hand is requested together with its feature: alone, it would have to be one that the standard limits.
  const setHolder = event => replace(['groups', group.id],
    { ...query, tool: undefined, in_hand: undefined, feature: query.feature ?? data?.feature, ...handOrToolQuery(event.target.value) });
  const holder = handOrTool(current ?? query);
  const choose = (label, key, value, options) => html`<${Field} type="select" label=${label} value=${value} options=${options}
    onInput=${event => set(key, event.target.value)} />`;
  return html`
    <section class="card">
      <div class="filters">
        ${choose(words.task, 'task', task.id, tasks.map(one => [one.id, one.name]))}
        ${choose(words.feature, 'feature', query.feature, [['', words.asked], ...features.map(one => [one.name, featureTitle(one)])])}
        ${feature?.of_tools && html`<${Field} type="select" label=${t.standardForm.hand} value=${holder} onInput=${setHolder}
          options=${handChoices(feature, holder)} />`}
      </div>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!current && !problem && html`<${Loading} />`}
      ${current?.trainees.length === 0 && html`<${Empty} title=${words.empty} body=${words.emptyBody}>
        <a class="button main" href=${href(['enrol'], { group: group.name })}>${words.enrol}</a><//>`}
      ${current && current.trainees.length > 0 && html`<${GroupTable} progress=${current} />`}
      ${current?.more && html`<p class="body small muted">${words.more(current.rows.length)}</p>`}
    </section>`;
}
