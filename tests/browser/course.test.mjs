// A course in a real Chromium. An instructor makes a plan with the keyboard, lets a group follow it, and sees each
// trainee's progress in its table. A trainee sees the next step and its due date, and nothing of others. The plan is
// then changed, and the group stops following it. One scenario in steps; each step needs the steps before it.
//
// Environment: as person.mjs.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch, LOOKS } from './chromium.mjs';
import { person, waitUntil, url } from './person.mjs';

const mark = Date.now().toString(36); // So that the scenario can run again in the same centre.
const PLAN = `Basic skills ${mark}`;
const GROUP = `Spring course ${mark}`;
const [ADA, BEN] = [`Ada Sjöberg ${mark}`, `Ben Abara ${mark}`];
const SECRET = 'a password of a course';
const DAY_MS = 86_400_000;
const made = {}; // What the steps created: the box, tasks, group, trainees and plan.

let browser;
let admin; // The administrator, who prepares the centre.
let teacher;
let trainee;

before(async () => {
  browser = await launch();
  [admin, teacher] = await Promise.all([person(browser), person(browser, { prefix: 'course-' })]);
  trainee = await person(browser, { viewport: LOOKS[1].viewport, prefix: 'course-' });
});

after(() => browser?.close());

/** The date this many days from now, in the format of the service and of date inputs. */
const day = days => new Intl.DateTimeFormat('sv-SE').format(new Date(Date.now() + days * DAY_MS));
/** The same date in the format of the pages. */
const dayWords = days => new Intl.DateTimeFormat('en-US', { dateStyle: 'medium' }).format(new Date(Date.now() + days * DAY_MS)).replaceAll(' ', '\u00a0');

/**
 * Imports a session with two tools, this many seconds long and recorded this many days ago, as a CSV of another
 * tracker.
 */
async function importPractice(learner, task, seconds, days) {
  const lines = ['frame,time_s,tool,x_mm,y_mm,z_mm,sigma_xy_mm,sigma_z_mm'];
  for (let frame = 0; frame < seconds * 25; frame += 1) {
    const moved = Math.min(Math.max(frame, 25), (seconds - 1) * 25); // at rest for the first and the last second
    for (const tool of ['left', 'right'])
      lines.push(`${frame},${frame / 25},${tool},${40 * Math.sin(moved / 20)},${20 * Math.cos(moved / 30)},150,0.1,0.4`);
  }
  const recorded = new Date(Date.now() - days * DAY_MS).toISOString();
  const query = new URLSearchParams({ trainee: learner.id, task: task.id, box: made.box.id, tracker: 'Kinovea', recorded_at: recorded });
  const status = await admin.page.evaluate(async ([at, body]) =>
    (await fetch(at, { method: 'POST', headers: { 'Content-Type': 'text/csv' }, body })).status, [`/api/v1/sessions/import?${query}`, lines.join('\n')]);
  assert.equal(status, 201);
}

test('a centre is prepared with two tasks, one with a standard, and a group with its own instructor', async () => {
  await admin.page.goto(url);
  await admin.signIn();
  await admin.page.locator('header.top nav').waitFor();
  const { create } = admin;
  made.box = await create('boxes', { name: `Course table ${mark}` });
  made.pegs = await create('tasks', { name: `Course pegs ${mark}` });
  made.wire = await create('tasks', { name: `Course wire ${mark}` });
  const by = { method: 'fixed', limit: 30, unit: 's' };
  await create(`tasks/${made.pegs.id}/standards`, { targets: [{ feature: 'duration', by }], rule: { in_a_row: 2 } });
  made.group = await create('groups', { name: GROUP });
  [made.ada, made.ben] = await Promise.all([ADA, BEN].map(name => create('trainees', { name, group: made.group.id })));
  const account = { name: 'x', password: SECRET };
  await create('people', { ...account, login: `teacher-${mark}`, name: `Teacher ${mark}`, role: 'instructor', groups: [made.group.id] });
  await create('people', { ...account, login: `ada-course-${mark}`, name: ADA, role: 'trainee', trainee: made.ada.id });
  await importPractice(made.ada, made.pegs, 4, 3);
  await importPractice(made.ada, made.pegs, 5, 2);
  await importPractice(made.ada, made.wire, 4, 1);
  const passed = async () => (await admin.getJson(`trainees/${made.ada.id}/progress?task=${made.pegs.id}`)).passed;
  await waitUntil(passed, 'the pass');
});

test('an instructor makes a plan with the keyboard alone; a task without a standard counts sessions', async () => {
  const { page, button, heading } = teacher;
  await page.goto(`${url}/groups`);
  await teacher.signIn(SECRET, `teacher-${mark}`);
  await page.locator('.head').getByRole('link', { name: 'Course plans' }).click();
  await heading('Course plans').waitFor();
  await page.getByRole('link', { name: 'Make a course plan' }).first().click();
  await heading('Make a course plan').waitFor();
  await page.getByLabel('Name').fill(PLAN);
  const step = n => page.getByRole('group', { name: `Step ${n}`, exact: true });
  // The page moves the focus by a timer after each press. A key pressed before that would go to another element.
  const hasFocus = element => new Promise(done => setTimeout(() => done(element === document.activeElement)));
  const pressAndWait = async (name, focused) => {
    await button(name).press('Enter');
    await waitUntil(() => focused.evaluate(hasFocus), `the focus after ${name}`);
  };
  await step(1).getByLabel('Task').selectOption({ label: made.wire.name });
  await step(1).getByText('This task has no standard to pass yet').waitFor();
  assert.deepEqual(await step(1).getByLabel('Counts as done').locator('option').allInnerTexts(), ['Sessions recorded']);
  await step(1).getByLabel('Sessions').fill('2');
  await step(1).getByLabel('Due after').fill('3');
  await pressAndWait('Add a step', step(2));
  await step(2).getByLabel('Task').selectOption({ label: made.pegs.name });
  await step(2).getByLabel('Due after').fill('14');
  await pressAndWait('Add a step', step(3));
  await step(3).getByLabel('Task').selectOption({ label: made.pegs.name });
  await step(3).getByLabel('Counts as done').selectOption('sessions');
  await step(3).getByLabel('Sessions').fill('10');
  await pressAndWait('Add a step', step(4));
  await pressAndWait('Remove step 4', step(3));
  await page.locator('.unseen', { hasText: 'Step 4 is removed' }).waitFor({ state: 'attached' });
  // A moved step keeps its input and the focus. At the end of the list the focus moves to the button that still works.
  await pressAndWait('Move step 2 up', button('Move step 1 down'));
  await page.locator('.unseen', { hasText: 'Step 2 is now step 1' }).waitFor({ state: 'attached' });
  assert.equal(await step(1).getByLabel('Due after').inputValue(), '14');
  await pressAndWait('Move step 1 down', button('Move step 2 down'));
  await pressAndWait('Move step 2 up', button('Move step 1 down'));
  await teacher.takePictures('01-plan');
  await button('Save').press('Enter');
  await heading('Course plans').waitFor();
  await page.locator('tr', { hasText: PLAN }).getByText('none of your groups').waitFor();
  made.plan = (await teacher.getJson('courses?limit=200')).items.find(one => one.name === PLAN);
  const steps = made.plan.steps.map(one => [one.task.name, one.sessions, one.within_days]);
  assert.deepEqual(steps, [[made.pegs.name, null, 14], [made.wire.name, 2, 3], [made.pegs.name, 10, null]]);
});

test('the group follows the plan from a chosen day, and its table shows each trainee’s progress', async () => {
  const { page, button, heading } = teacher;
  await page.goto(`${url}/groups/${made.group.id}`);
  await heading(GROUP).waitFor();
  await page.getByText('This group follows no course plan').waitFor();
  await button('Follow a course plan').click();
  const dialog = page.locator('dialog');
  await dialog.getByLabel('Plan').selectOption({ label: PLAN });
  assert.equal(await dialog.getByLabel('First day').inputValue(), day(0));
  await dialog.getByLabel('First day').fill(day(-4));
  await button('Save').click();
  const table = page.locator('.course-table');
  await table.waitFor();
  assert.match(await table.locator('thead').innerText(), new RegExp(`by ${dayWords(10)}`));
  const cell = (name, task, state) => table.getByRole('link', { name: `${name}, ${task}: ${state}` });
  await cell(ADA, made.pegs.name, `Passed ${dayWords(-2)}`).waitFor();
  await cell(ADA, made.wire.name, 'In progress Overdue 1 of 2 sessions').waitFor();
  await cell(ADA, made.pegs.name, 'In progress 2 of 10 sessions').waitFor();
  await cell(BEN, made.wire.name, 'Not begun Overdue').waitFor();
  await page.locator('tr', { hasText: ADA }).first().getByText('1 of 3').waitFor();
  const card = page.locator('.card.course');
  const [file] = await Promise.all([page.waitForEvent('download'), card.getByRole('button', { name: 'Save as table (CSV)' }).click()]);
  const saved = readFileSync(await file.path(), 'utf8');
  assert.ok(saved.startsWith('\uFEFF') && file.suggestedFilename().endsWith('.csv'));
  const line = saved.split('\r\n').find(row => row.startsWith(ADA));
  assert.match(line, new RegExp(`^${ADA},1 of 3,`));
  assert.ok(line.includes('In progress, Overdue, 1 of 2 sessions'), saved);
  await teacher.takePictures('02-table');
  await cell(ADA, made.wire.name, 'In progress').click();
  await heading(ADA).waitFor();
  await page.getByText(`Next step: ${made.wire.name} (2 sessions), by ${dayWords(-1)}.`).waitFor();
  await teacher.takePictures('03-trainee');
});

test('a trainee sees the next step and its due date, and nothing of others', async () => {
  const { page, heading } = trainee;
  await page.goto(url);
  await trainee.signIn(SECRET, `ada-course-${mark}`);
  await page.getByText('Your course').waitFor();
  await page.getByText(`Next step: ${made.wire.name} (2 sessions), by ${dayWords(-1)}.`).waitFor();
  assert.ok(!(await page.locator('main').innerText()).includes(GROUP), 'groups are not shown to trainees');
  const last = page.getByRole('region', { name: 'Your last result' });
  await last.getByText(made.wire.name).waitFor();
  await last.getByText(/^Time |· Time /).waitFor();
  assert.equal(await page.locator('.figures').count(), 0, 'no figures of the service’s queue');
  await trainee.takePictures('04-today');
  await page.getByRole('link', { name: 'All steps' }).click();
  await heading(ADA).waitFor();
  assert.equal(await page.locator('.own-course ol li').count(), 3);
  await page.locator('.own-course li', { hasText: made.wire.name }).getByText('Overdue').waitFor();
  await trainee.takePictures('05-own');
  for (const path of [`/groups/${made.group.id}`, '/courses', `/courses/${made.plan.id}`]) {
    await page.goto(url + path);
    await page.locator('main', { hasText: 'There is no such page' }).waitFor();
  }
  const status = await page.evaluate(async at => (await fetch(at)).status, `/api/v1/trainees/${made.ben.id}/courses`);
  assert.equal(status, 404);
});

test('feedback is marked as new on the trainee’s home until the session is opened, and is in its report', async () => {
  const { page } = trainee;
  const [session] = (await admin.getJson(`sessions?trainee=${made.ada.id}&task=${made.pegs.id}&limit=1`)).items;
  const remark = 'Keep both tips in view.';
  await teacher.page.goto(`${url}/sessions/${session.id}`);
  const form = teacher.page.getByRole('region', { name: 'Box trainer form' });
  await form.getByRole('button', { name: 'Rate', exact: true }).click();
  const items = await form.getByRole('group').all();
  for (const [at, item] of items.entries()) await item.getByText(at ? '4' : 'does not apply', { exact: true }).click();
  await form.getByLabel('Remark on the whole session').fill(remark);
  await form.getByRole('button', { name: 'Give this rating' }).click();
  await form.getByText('20 of 25').waitFor();
  await teacher.create(`sessions/${session.id}/comments`, { from_s: 1, text: 'Well planned.' });

  await trainee.open('/');
  const news = page.getByRole('region', { name: 'New feedback' });
  await news.getByText(`1 rating, 1 comment · by Teacher ${mark}`).waitFor();
  await page.locator('header.top nav').getByText('1 session with new feedback').waitFor({ state: 'attached' });
  await trainee.takePictures('06-feedback');
  await news.getByRole('link').first().click();
  await page.getByText(remark).waitFor();
  await page.locator('header.top nav .count').waitFor({ state: 'detached' });
  await trainee.open(`/sessions/${session.id}/report`);
  const report = page.locator('.report');
  for (const text of ['20 of 25', '(1 item does not apply)', remark, 'Well planned.']) await report.getByText(text).first().waitFor();
  await trainee.open('/');
  await page.getByRole('region', { name: 'Your last result' }).waitFor();
  assert.equal(await news.count(), 0);
});

test('the open page shows that a step is done as soon as the missing session is scored', async () => {
  const { page, open } = trainee;
  await open('/');
  // The page misses events that occur before it is connected.
  await page.locator('.head [role=status]', { hasText: /^Live$/ }).waitFor();
  await importPractice(made.ada, made.wire, 5, 0);
  await page.getByText(`Next step: ${made.pegs.name} (10 sessions), at any time.`).waitFor();
});

test('a group follows the changed plan', async () => {
  const { page, button, heading } = teacher;
  await page.goto(`${url}/courses/${made.plan.id}`);
  await heading('Change the course plan').waitFor();
  await button('Remove step 3').click();
  await button('Save').click();
  await heading('Course plans').waitFor();
  await page.locator('tr', { hasText: PLAN }).getByRole('link', { name: GROUP }).click();
  await page.locator('.course-table tr', { hasText: ADA }).getByText('2 of 2').waitFor();
});

test('in every look, every page of a course fits the screen and is accessible', async () => {
  const pages = {
    courses: '/courses', course: `/courses/${made.plan.id}`, group: `/groups/${made.group.id}`, trainee: `/trainees/${made.ben.id}`,
  };
  const faults = [];
  const checkPage = async (user, name, path) => {
    await user.open(path);
    await user.checkLooks(`page-${name}`, async look =>
      faults.push(...(await violationsOf(user.page)).map(violation => `${name}, ${look.name}: ${violation}`)));
  };
  for (const [name, path] of Object.entries(pages)) await checkPage(teacher, name, path);
  await checkPage(trainee, 'own-today', '/');
  assert.deepEqual(faults, []);
});

test('a plan cannot be deleted while a group follows it, and can be deleted afterwards', async () => {
  const { page, button } = teacher;
  const remove = async () => {
    await teacher.open('/courses');
    await button(`Delete: ${PLAN}`).click();
    await page.locator('dialog').getByRole('button', { name: 'Delete', exact: true }).click();
  };
  await remove();
  await page.locator('dialog .notice.bad', { hasText: 'Course plan is still used by groups' }).waitFor();
  await teacher.open(`/groups/${made.group.id}`);
  await button(`Stop following ${PLAN}`).click();
  await page.locator('dialog').getByRole('button', { name: 'Stop following', exact: true }).click();
  await page.getByText('This group follows no course plan').waitFor();
  await remove();
  await page.locator('tr', { hasText: PLAN }).waitFor({ state: 'detached' });
  assert.deepEqual((await teacher.getJson(`trainees/${made.ada.id}/courses`)).items, []);
});

test('no page sent a request to another origin, violated the security policy or threw an error', () => {
  const stillFollowed = /status of 409 .*\/courses\//; // The plan could not be deleted.
  const otherTrainee = /status of 404 .*\/courses$/; // A trainee may not see another trainee's course.
  for (const user of [admin, teacher, trainee]) {
    const { foreign, errors } = user.pageFaults();
    assert.deepEqual([foreign, errors.filter(line => !stillFollowed.test(line) && !otherTrainee.test(line))], [[], []]);
  }
});
