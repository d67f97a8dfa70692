// A group's trainees against the steps of its course.
import { html } from '../../preact.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { SaveTable } from '../page/save_table.js';
import { dueText, requirementText, StepState, stepText } from './course_state.js';

const words = t.courses;

export const CourseTable = ({ group, course: { steps, trainees, rows } }) => html`
  <div class="scroll"><table class="table course-table">
    <thead><tr>
      <th scope="col">${t.groups.name}</th><th scope="col">${words.done}</th>
      ${steps.map((step, at) => html`<th scope="col" key=${at}><a href=${href(['tasks', step.task.id])}>${at + 1}. ${step.task.name}</a>
        <small>${requirementText(step)}</small><small>${dueText(step)}</small></th>`)}
    </tr></thead>
    <tbody>${rows.map(row => html`<${Row} key=${row.trainee} row=${row} steps=${steps}
      name=${nameIn(trainees, row)} />`)}</tbody>
  </table></div>
  <${SaveTable} name=${`${group.name} ${t.courses.ofGroup}`} rows=${() => tableRows(steps, trainees, rows)} />`;

const nameIn = (trainees, row) => trainees.find(one => one.id === row.trainee).name;

/** The table for a spreadsheet. */
const tableRows = (steps, trainees, rows) => [
  [t.groups.name, words.done, ...steps.map((step, at) => `${at + 1}. ${step.task.name}`)],
  ...rows.map(row => [nameIn(trainees, row), words.doneOf(row.steps.filter(one => one.state === 'passed').length, steps.length),
    ...row.steps.map((progress, at) => stepText(steps[at], progress))]),
];

const Row = ({ row, steps, name }) => html`
  <tr>
    <th scope="row"><a class="cover" href=${href(['trainees', row.trainee])}>${name}</a></th>
    <td class="when">${words.doneOf(row.steps.filter(one => one.state === 'passed').length, steps.length)}</td>
    ${row.steps.map((progress, at) => html`<td key=${at}><a class="step" href=${href(['trainees', row.trainee], { task: steps[at].task.id })}>
      <span class="unseen">${words.of(name, steps[at].task.name)} </span><${StepState} step=${steps[at]} progress=${progress} /></a></td>`)}
  </tr>`;
