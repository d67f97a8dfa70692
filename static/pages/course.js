// One course plan, new or edited: its name and its ordered steps.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { go, href } from '../router.js';
import { t } from '../texts.js';
import { CourseSteps, newStep, stepRequest } from '../parts/courses/course_steps.js';
import { Form } from '../parts/forms/form.js';
import { NotYours, ownerGroups, ownersField } from '../parts/forms/owners.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.courses;
const NEW = 'new'; // In the address, instead of an id.

/** @param {Props} props */
export default function CoursePage({ person, route }) {
  const id = route.params.id === NEW ? null : route.params.id;
  const { data, problem, reload } = useData(async signal => {
    const [course, tasks, groups] = await Promise.all([id && api.courses.get(id, signal), api.tasks.all(), ownerGroups(person)]);
    return { course, tasks, groups };
  }, [id]);
  if (data?.course && !data.course.may_change) return html`<${OthersPlan} plan=${data.course} />`;
  return html`
    <${PageHead} title=${id ? words.edit : words.add} lead=${id ? words.editLead : words.newLead}>
      <a class="button" href=${href(['courses'])}>${words.all}</a>
    <//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!data && !problem && html`<${Loading} />`}
    ${data?.tasks.length === 0 && html`<${Empty} title=${t.groups.noTasks} body=${words.noTasksBody}>
      <a class="button main" href=${href(['tasks'])}>${words.toTasks}</a><//>`}
    ${data && data.tasks.length > 0 && html`<${Plan} ...${data} person=${person} />`}`;
}

/** @param {Props} props */
const OthersPlan = ({ plan }) => html`
  <${PageHead} title=${plan.name}><a class="button" href=${href(['courses'])}>${words.all}</a><//>
  <div class="stack">
    <${NotYours} />
    <section class="card"><header><h2>${words.steps}</h2></header>
      <div class="body"><ol>${plan.steps.map((step, at) => html`<li key=${at}>${step.task.name}</li>`)}</ol></div></section>
  </div>`;

/** @param {Props} props */
function Plan({ course, tasks, groups, person }) {
  const [steps, setSteps] = useState(() => (course ? course.steps.map(newStep) : [newStep()]));
  const save = async values => {
    const plan = { ...values, steps: steps.map(stepRequest) };
    await (course ? api.courses.replace(course.id, plan) : api.courses.create(plan));
    go(['courses']);
  };
  const fields = [{ name: 'name', label: words.name, required: true, maxlength: 120, value: course?.name },
    ...ownersField(groups, course, person)];
  return html`
    <section class="card"><div class="body">
      <${Form} fields=${fields} onSave=${save} onCancel=${() => go(['courses'])}>
        <${CourseSteps} steps=${steps} tasks=${tasks} onChange=${setSteps} /><//>
    </div></section>`;
}
