// Consent in a real Chromium. An administrator publishes a text after a look at its effect. A trainee reads and refuses it,
// and the page Upload names the reason. Staff record a paper, and the trainee withdraws and reads who looked at the
// recordings. The text is required only in two weeks, so that it stops no other trainee of the centre.
//
// Environment: as person.mjs.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';

import { violationsOf } from './accessibility.mjs';
import { launch } from './chromium.mjs';
import { person, url, waitUntil } from './person.mjs';

const mark = Date.now().toString(36); // So that the scenario can run again in the same centre.
const NAME = `Mia Consent ${mark}`;
const SECRET = 'a password of consent';
const made = {};

let browser;
let admin;
let trainee;

before(async () => {
  browser = await launch();
  [admin, trainee] = await Promise.all([person(browser, { prefix: 'consent-' }), person(browser, { prefix: 'consent-own-' })]);
});

after(() => browser?.close());

/** A path of another tracker, as a session of the trainee. */
async function importSession() {
  const lines = ['frame,time_s,tool,x_mm,y_mm,z_mm'];
  for (let frame = 0; frame < 200; frame += 1)
    for (const tool of ['left', 'right']) lines.push(`${frame},${frame / 25},${tool},${20 * Math.sin(frame / 20)},${20 * Math.cos(frame / 30)},150`);
  const query = new URLSearchParams({ trainee: made.mia.id, task: made.task.id, box: made.box.id, tracker: 'Kinovea' });
  return admin.page.evaluate(async ([at, body]) => {
    const answer = await fetch(at, { method: 'POST', headers: { 'Content-Type': 'text/csv' }, body });
    return { status: answer.status, ...(await answer.json()) };
  }, [`/api/v1/sessions/import?${query}`, lines.join('\n')]);
}

test('a text is published after its effect was shown', async () => {
  await admin.page.goto(url);
  await admin.signIn();
  await admin.page.locator('header.top nav').waitFor();
  made.box = await admin.create('boxes', { name: `Consent table ${mark}` });
  made.task = await admin.create('tasks', { name: `Consent pegs ${mark}` });
  made.mia = await admin.create('trainees', { name: NAME });
  await admin.create('people', { login: `mia-${mark}`, name: NAME, role: 'trainee', password: SECRET, trainee: made.mia.id });
  made.session = await importSession();
  await admin.open('/consent');
  await admin.button('New version').click();
  await admin.page.fill('[name=title_en]', 'Recordings of your training');
  await admin.page.fill('[name=body_en]', 'We record your hands and instruments.\n\nYou can withdraw at any time.');
  await admin.page.fill('[name=title_de]', 'Aufnahmen Ihres Trainings');
  await admin.page.fill('[name=body_de]', 'Wir nehmen Ihre Hände und Instrumente auf.');
  await admin.takePictures('write');
  await admin.button('Check the effect').click();
  await admin.page.getByText(/of \d+ trainees have not consented/).waitFor();
  await admin.page.getByText('Aufnahmen Ihres Trainings').waitFor();
  await admin.takePictures('effect');
  await admin.button('Publish').click();
  await admin.page.getByText(/required from/).first().waitFor();
  assert.deepEqual(await violationsOf(admin.page), []);
  await admin.takePictures('texts');
});

test('a trainee is asked, refuses, and no recording can be sent', async () => {
  await trainee.page.goto(url);
  await trainee.signIn(SECRET, `mia-${mark}`);
  await trainee.page.getByText(/Your centre asks for your consent/).waitFor();
  await trainee.takePictures('today');
  await trainee.page.getByRole('link', { name: 'Read the text and decide' }).click();
  await trainee.page.getByText('We record your hands and instruments.').waitFor();
  assert.deepEqual(await violationsOf(trainee.page), []);
  await trainee.takePictures('account');
  await trainee.button('I do not consent').click();
  await trainee.page.getByText('No consent: refused').waitFor();
  await trainee.open('/upload');
  await trainee.page.getByText(`${NAME} does not consent to recordings, so none can be sent.`).waitFor();
  await trainee.takePictures('upload');
  assert.equal((await importSession()).status, 403);
});

test('staff record a paper, and see that it is missing in the list', async () => {
  await admin.open('/trainees');
  await admin.page.locator('tr', { hasText: NAME }).getByText('No consent: refused').waitFor();
  await admin.takePictures('trainees');
  await admin.open(`/trainees/${made.mia.id}`);
  await admin.button('Record a signed paper').click();
  await admin.page.fill('[name=signed_on]', new Intl.DateTimeFormat('sv-SE').format(new Date()));
  await admin.takePictures('paper');
  await admin.button('Record the consent').click();
  await admin.page.getByText('The trainee has consented. New recordings can be made.').waitFor();
  await admin.button('Change the time').click();
  await admin.page.fill('[name=months]', '6');
  await admin.button('Save').click();
  await admin.page.getByText('6 months (set for this person)').waitFor();
  assert.deepEqual(await violationsOf(admin.page), []);
  await admin.takePictures('trainee');
  await admin.open(`/sessions/${made.session.id}`);
});

test('the trainee reads who looked, and withdraws', async () => {
  const entries = async () => (await trainee.getJson(`trainees/${made.mia.id}/access-entries`)).items;
  await waitUntil(async () => (await entries()).length > 0, 'the entry');
  await trainee.open('/account');
  const log = trainee.page.locator('section', { hasText: 'Who looked at my recordings' });
  await log.getByRole('link', { name: new RegExp(`Consent pegs ${mark}`) }).first().waitFor();
  await trainee.button('Withdraw my consent').click();
  await trainee.takePictures('withdraw');
  await trainee.button('Withdraw the consent').click();
  await trainee.page.getByText('No consent: withdrawn').waitFor();
  await trainee.page.getByText(/decisions, with the texts/).click();
  await trainee.page.getByText(/on paper of/).waitFor();
  await trainee.takePictures('withdrawn');
  for (const { foreign, errors } of [admin.pageFaults(), trainee.pageFaults()]) {
    assert.deepEqual(foreign, []);
    assert.deepEqual(errors.filter(error => !/status of 403 .*import/.test(error)), []); // the refused import of the test itself
  }
});
