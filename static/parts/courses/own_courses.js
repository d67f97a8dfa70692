// The courses of a trainee: the next step with its due date, and all steps.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useThrottled } from '../../data.js';
import { calendarDay } from '../../format.js';
import { useLive } from '../../live.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { dueText, requirementText, StepState } from './course_state.js';

const words = t.courses;
const RELOAD_MS = 2_000;

/**
 * `first`: what the page has loaded already; it is loaded again after every scored session. `brief`: only the next
 * step, with a link to all.
 */
export function OwnCourses({ trainee, first, brief }) {
  const [courses, setCourses] = useState(first);
  // On failure, the old courses stay.
  const reloadSoon = useThrottled(() => api.trainees.courses(trainee).then(setCourses, () => {}), RELOAD_MS);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);
  return courses.map(one => html`
    <section class="card own-course" key=${`${one.course.id} ${one.course.begins} ${one.group?.id}`}>
      <header>
        <div><h2>${brief ? words.own : words.course(one.course.name)}</h2><p class="small muted">${subtitle(one, brief)}</p></div>
        ${brief && html`<a href=${href(['trainees', trainee])}>${words.whole}</a>`}
      </header>
      <${NextStep} course=${one} />
      ${!brief && html`<${Steps} steps=${one.steps} trainee=${trainee} />`}
    </section>`);
}

const subtitle = ({ group, course }, brief) =>
  [group?.name, brief && course.name, words.firstDay(calendarDay(course.begins))].filter(Boolean).join(' · ');

function NextStep({ course: { next, steps } }) {
  if (next === null) return html`<p class="body">${words.allDone}</p>`;
  const step = steps[next - 1];
  return html`<p class="body row"><strong>${words.next(step.task.name, requirementText(step), dueText(step))}</strong>
    ${step.progress.overdue && html`<span class="pill bad">${words.overdue}</span>`}</p>`;
}

const Steps = ({ steps, trainee }) => html`
  <ol class="queue">${steps.map((step, at) => html`<li key=${at}>
    <div><a href=${href(['trainees', trainee], { task: step.task.id })}>${at + 1}. ${step.task.name}</a>
      <span class="small muted">${requirementText(step)}, ${dueText(step)}</span></div>
    <${StepState} step=${step} progress=${step.progress} /></li>`)}</ol>`;
