// The courses that a trainee is in: the next step and until when, and all of them.
import { html, useState } from './preact.js';
import { api } from '../api.js';
import { useThrottled } from '../data.js';
import { calendarDay } from '../format.js';
import { useLive } from '../live.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { askedWords, dueWords, StepState } from './course_state.js';

const words = t.courses;
const AGAIN_MS = 2_000;

/** `first`: what the page knows already; it is read anew with every session that is done. `brief`: the next step alone, and the way to all. */
export function OwnCourses({ trainee, first, brief }) {
  const [courses, setCourses] = useState(first);
  const soon = useThrottled(() => api.trainees.courses(trainee).then(setCourses, () => {}), AGAIN_MS); // What was told stays until the next time.
  useLive('session', event => event.status === 'done' && soon());
  useLive('resync', soon);
  return courses.map(one => html`
    <section class="card own-course" key=${`${one.course.id} ${one.course.begins} ${one.group?.id}`}>
      <header>
        <div><h2>${brief ? words.own : words.course(one.course.name)}</h2><p class="small muted">${about(one, brief)}</p></div>
        ${brief && html`<a href=${href(['trainees', trainee])}>${words.whole}</a>`}
      </header>
      <${Next} of=${one} />
      ${!brief && html`<${Steps} steps=${one.steps} trainee=${trainee} />`}
    </section>`);
}

const about = ({ group, course }, brief) =>
  [group?.name, brief && course.name, words.firstDay(calendarDay(course.begins))].filter(Boolean).join(' · ');

function Next({ of: { next, steps } }) {
  if (next === null) return html`<p class="body">${words.allDone}</p>`;
  const step = steps[next - 1];
  return html`<p class="body row"><strong>${words.next(step.task.name, askedWords(step), dueWords(step))}</strong>
    ${step.progress.overdue && html`<span class="pill bad">${words.overdue}</span>`}</p>`;
}

const Steps = ({ steps, trainee }) => html`
  <ol class="queue">${steps.map((step, at) => html`<li key=${at}>
    <div><a href=${href(['trainees', trainee], { task: step.task.id })}>${at + 1}. ${step.task.name}</a>
      <span class="small muted">${askedWords(step)}, ${dueWords(step)}</span></div>
    <${StepState} step=${step} progress=${step.progress} /></li>`)}</ol>`;
