// Every figure that a page shows is one that REST tells anybody: read from the page by its label, asked of REST with the same
// sign-in, and compared after the pages' rounding, which is written here anew. Each page is then shown once with an answer that was
// altered on its way: a comparison that does not notice that would compare nothing. What is shown live is held against what the page's
// own socket told last.
//
// Environment: as person.mjs; the centre has a scored recording. TROCAR_TASK (the task whose standard is looked at; otherwise that of
// the newest scored recording).
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { setTimeout as pause } from 'node:timers/promises';

import { launch } from './chromium.mjs';
import { person, until, url } from './person.mjs';
import { beginFeed, endFeed } from './sender.mjs';

const DAY_MS = 86_400_000;

let browser;
let page, make, open;
let cookie;
let session, progress, pass;

/** What REST tells any program: nothing that stands between it and the page touches this. */
async function rest(path) {
  const answer = await fetch(`${url}/api/v1/${path}`, { headers: { cookie } });
  assert.ok(answer.ok, `${path}: ${answer.status}`);
  return answer.json();
}

/** All of a list. */
async function all(path) {
  const items = [];
  for (let cursor = ''; cursor !== null; ) {
    const told = await rest(`${path}${path.includes('?') ? '&' : '?'}limit=200${cursor && `&cursor=${encodeURIComponent(cursor)}`}`);
    items.push(...told.items);
    cursor = told.next ?? null;
  }
  return items;
}

// How pages write figures.

const plain = value => (Math.abs(value) < 1e20 ? value.toFixed(12).replace(/\.?0+$/, '') : String(value));

/** A true minus, and a comma between thousands. */
function written(text) {
  const [whole, rest] = text.replace('-', '−').split('.');
  return whole.replace(/\B(?=(\d{3})+$)/g, ',') + (rest ? `.${rest}` : '');
}

/** So many digits after the point, half away from zero, by the number as it is written: 4.395 makes 4.40. */
const fixed = (value, digits) =>
  (Math.sign(value) * Number(`${Math.round(Number(`${Math.abs(value)}e${digits}`))}e-${digits}`)).toFixed(digits);

/** A value: three telling digits; whole numbers below ten thousand are counts, and exact. */
function three(value) {
  if (value === null || value === undefined) return '–';
  const size = Math.abs(value);
  if (Number.isInteger(value) && size < 10_000) return written(String(value));
  if (size < 0.1 || size >= 10_000) return written(plain(Number(value.toPrecision(3))));
  return written(fixed(value, size >= 100 ? 0 : size >= 10 ? 1 : 2));
}

/** A value and half its error's range: both to the second telling digit of that, if it stands within three behind the point; otherwise
 *  the value as it is alone, and two telling digits. */
function withError(value, { low, high }) {
  const half = (high - low) / 2;
  const digits = half >= 0.01 && half < 100 ? [100, 10, 1, 0.1].findIndex(size => half >= size / 10) : -1;
  if (digits < 0) return [three(value), written(plain(Number(half.toPrecision(2))))];
  return [fixed(value, digits), fixed(half, digits)].map(written);
}

const percent = share => `${written(plain(Number(fixed(100 * share, 1))))}%`;
const wholePercent = share => `${Math.round(100 * share)}%`;

/** `1:02.3` */
const clock = (seconds, digits) => {
  const [minutes, rest] = [Math.floor(Number(seconds.toFixed(digits)) / 60), Number(seconds.toFixed(digits)) % 60];
  return `${minutes}:${rest.toFixed(digits).padStart(digits ? digits + 3 : 2, '0')}`;
};

function bytes(count) {
  const step = [1e9, 1e6, 1e3].findIndex(size => count >= size);
  return step < 0 ? `${count} B` : `${(count / [1e9, 1e6, 1e3][step]).toFixed(1)} ${['GB', 'MB', 'kB'][step]}`;
}

/** The figures in a sentence, in order, as they are written; the words round them are not the matter here. */
const figuresIn = text => text.match(/[−-]?\d+(,\d{3})*(\.\d+)?%?/g) ?? [];

// How they are read from a page.

/** `{ name: what stands there }` of a list of names and values. */
const facts = locator =>
  locator.locator('dt').evaluateAll(names => Object.fromEntries(names.map(name => [name.textContent.trim(), name.nextElementSibling.textContent.trim()])));

/** The words of every cell of a table's body. */
const cells = locator =>
  locator.locator('tbody tr').evaluateAll(rows => rows.map(row => [...row.cells].map(cell => cell.textContent.replace(/\s+/g, ' ').trim())));

/** The features' table, a line for each cell: what it stands for, and everything that is said there. */
const featureCells = () =>
  page.locator('.fourth table').evaluate(table => {
    const own = node => [...node.childNodes].filter(child => child.nodeType === 3).map(child => child.textContent).join('').trim();
    const columns = [...table.tHead.rows[0].cells].slice(1, -1).map(cell => cell.textContent.trim());
    return [...table.querySelectorAll('tbody tr')].filter(row => row.cells.length === columns.length + 2).flatMap(row =>
      columns.map((column, at) => {
        const cell = row.cells[at + 1];
        const title = own(row.cells[0]) || row.cells[0].querySelector('button').textContent.trim();
        const said = ['.not-enough', '.off', '.limit', '.place', '.told-live'].map(part => cell.querySelector(`:scope > ${part}`)?.textContent.trim() ?? '');
        return [`${title}, ${column}`, [own(cell), ...said].join('|')];
      }));
  }).then(Object.fromEntries);

// What each page shows, as `[what, what stands there, what REST tells]`.

/** What is told of a value's place, by feature and tool, if the session is the one that is placed; what withholds all is said once. */
async function placesOf({ id, trainee, task, features }) {
  const [cohort] = await all('cohorts');
  const places = new Map();
  const reasons = new Set();
  for (const feature of new Set(features.filter(one => one.space === '3d' && one.value !== null).map(one => one.name))) {
    const told = await rest(`trainees/${trainee.id}/progress?task=${task.id}&feature=${feature}&space=3d&cohort=${cohort.code}`);
    if (told.sessions.filter(one => !one.set_aside).at(-1)?.id !== id) return places;
    for (const { tool, place, no_place: withheld } of told.features) {
      const { value, low, high } = place?.better_than ?? place?.percentile ?? {};
      const said = place && `${place.better_than ? 'better than' : 'above'} ${Math.round(value)} % (${Math.round(low)} – ${Math.round(high)} %)`;
      reasons.add(place ? null : withheld.detail);
      places.set(`${feature} ${tool}`, said ?? (withheld.missing ? 'place: too few people' : 'no place'));
    }
  }
  return reasons.size === 1 && !reasons.has(null) ? new Map() : places;
}

function featureFigures(of, space, shown, places) {
  const live = new Map((space === '3d' ? (of.live_features ?? []) : []).map(one => [`${one.name} ${one.tool}`, one.value]));
  return of.features.filter(one => one.space === space).map(one => {
    const what = `${one.title}, ${one.tool ?? 'Both'}`;
    const isKnown = one.value !== null;
    const [value, half] = !isKnown ? ['not enough'] : one.error && !one.no_error ? withError(one.value, one.error) : [three(one.value)];
    const off = !isKnown ? '' : one.no_error ? '± ?' : half ? `± ${half}` : '';
    const limit = isKnown && one.target ? `at ${one.target.better === 'lower' ? 'most' : 'least'} ${three(one.target.limit)}` : '';
    const key = `${one.name} ${one.tool}`;
    const told = live.has(key) ? `live ${live.get(key) === null ? 'not enough' : three(live.get(key))}` : '';
    const place = isKnown && space === '3d' ? (places.get(key) ?? '') : '';
    const [shownValue, missing, error, asked = '', ...rest] = (shown[what] ?? '').split('|');
    return [what, [shownValue || missing, error, asked.split(':')[0], ...rest].join('|'), [value, off, limit, place, told].join('|')];
  });
}

async function ofSession() {
  const told = await rest(`sessions/${session.id}`);
  await page.locator('.plots canvas').nth(3).waitFor();
  const places = await placesOf(told);
  const isTold = () => page.waitForFunction(() => document.querySelector('.fourth .chooser [role=status]').textContent !== 'Loading …');
  await page.locator('.fourth .chooser [role=status]').waitFor({ state: 'attached' }); // It may have nothing to say.
  await isTold();
  const every = page.getByRole('button', { name: 'Of every feature' });
  if (await every.count()) {
    await every.click();
    await every.waitFor({ state: 'detached' });
    await isTold();
  }
  const figures = featureFigures(told, '3d', await featureCells(), places);
  if (told.features.some(one => one.space === 'image')) {
    await page.getByRole('button', { name: 'In the image', exact: true }).click();
    figures.push(...featureFigures(told, 'image', await featureCells()));
    await page.getByRole('button', { name: 'In space', exact: true }).click();
  }
  const made = await facts(page.locator('.card', { has: page.getByRole('heading', { name: 'Made with' }) }).locator('dl'));
  const { video } = told;
  figures.push(['length', made.Length, clock(video.duration_s, 1)], ['file', made.File, bytes(video.bytes)],
    ['picture', figuresIn(made.Picture).join(), [video.width, video.height, video.frames].join()]);
  const seen = page.locator('.card', { has: page.getByRole('heading', { name: 'What was seen' }) });
  for (const tool of told.quality.tools) {
    const all = tool.observed + tool.predicted + tool.missing;
    const part = seen.locator('section', { has: page.getByRole('heading', { name: tool.tool, exact: true }) });
    figures.push([`${tool.tool} seen`, figuresIn(await part.locator('p.small').first().innerText()).join(' '),
      [tool.observed, tool.predicted, tool.missing].map(count => percent(count / all)).join(' ')]);
    const { 'Error stated': error } = await facts(part.locator('dl'));
    if (error) figures.push([`${tool.tool} error`, figuresIn(error).join(' '), [three(tool.error_median_mm), '95', three(tool.error_p95_mm)].join(' ')]);
  }
  const frame = Number(/frame (\d+)/.exec(await page.locator('.transport .clock').innerText())[1]);
  const path = await rest(`sessions/${session.id}/trajectory?from_frame=${frame}&to_frame=${frame + 1}&trimmed=false`);
  for (const [at, name, x, y, z] of (await cells(page.locator('.readouts'))).map((row, at) => [at, ...row])) {
    const row = path.columns.tool.indexOf(at);
    const told = row < 0 ? ['–', '–', '–'] : ['x_mm', 'y_mm', 'z_mm'].map(field => written(fixed(path.columns[field][row], 1)));
    figures.push([`${name} at frame ${frame}`, [x, y, z].join(), told.join()]);
  }
  if (told.verdict?.level) {
    const said = await page.locator('.card', { has: page.getByRole('heading', { name: 'Skill', exact: true }) }).locator('p').first().innerText();
    figures.push(['probability', figuresIn(said)[0], wholePercent(told.verdict.probabilities[told.verdict.level])]);
  }
  return figures;
}

async function ofSessions() {
  const shown = await page.locator('tbody tr').evaluateAll(rows =>
    rows.map(row => [row.querySelector('a').pathname.split('/').pop(), row.querySelector('td.number').textContent.trim()]));
  const told = new Map((await rest('sessions?limit=50')).items.map(one => [one.id, one.video.duration_s]));
  assert.equal(shown.length, told.size);
  return shown.map(([id, length]) => [`length of ${id}`, length, told.get(id) === null ? '–' : clock(told.get(id), 0)]);
}

async function ofToday() {
  const { queue } = await rest('service');
  const [done, failed] = [await all('sessions?status=done'), await all('sessions?status=failed')];
  const recent = done.filter(one => Date.now() - Date.parse(one.created_at) < DAY_MS).length;
  await page.waitForFunction(() => !document.querySelector('.figures').textContent.includes('…'));
  const shown = await facts(page.locator('.figures'));
  const upTo50 = count => (count > 50 ? '50+' : String(count));
  return [['queued', shown['In the queue'], String(queue.queued)], ['running', shown['Being tracked'], String(queue.running)],
    ['finished', shown['Scored of the last 24 h'], upTo50(recent)], ['failed', shown['Could not be scored'], upTo50(failed.length)]];
}

async function ofTrainee() {
  const told = await rest(`trainees/${session.trainee.id}/progress?${progress}`);
  const [series] = told.features;
  const points = series.points.filter(point => point.value !== null);
  const dots = await page.locator('svg.progress-plot a').evaluateAll(all => all.map(dot => dot.getAttribute('aria-label')));
  const said = await facts(page.locator('dl.facts'));
  const unit = series.unit === '1' ? '' : ` ${series.unit}`;
  const figures = points.map((point, at) =>
    [`session ${point.session}`, (dots[at] ?? '').includes(`, ${three(point.value)}${unit}`) ? three(point.value) : dots[at], three(point.value)]);
  figures.push(['points', dots.length, points.length]);
  const { place, no_place: withheld, learning } = series;
  const of = place?.better_than ?? place?.percentile;
  const too_few = why => [...(why.missing ? [String(why.missing)] : []), ...figuresIn(why.detail)];
  figures.push(['place', figuresIn(said['Among others'].split('“')[0]).join(),
    (of ? [of.value, of.low, of.high].map(Math.round).concat(place.people) : withheld ? too_few(withheld) : []).join()]);
  if (learning.withheld) figures.push(['learning', figuresIn(said.Learning).join(), too_few(learning.withheld).join()]);
  if (learning.curve) figures.push(['plateau', figuresIn(said.Learning)[0], three(learning.curve.plateau.value)]);
  const { rule, charts } = told;
  if (rule) {
    const asked = [rule.in_a_row, ...(rule.then_more ? [rule.then_more] : []), ...(rule.at_most ? [rule.at_most] : [])];
    const sofar = rule.state === 'met' ? [rule.met_at] : rule.state === 'out_of_reach' ? []
      : [rule.have_in_a_row, rule.in_a_row, ...(rule.then_more ? [rule.have_more, rule.then_more] : []), ...(rule.unknown ? [rule.unknown] : [])];
    figures.push(['rule', figuresIn(said['Pass rule']).join(), [...asked, ...sofar].join()]);
  }
  if (charts) {
    const rates = figuresIn(said.Proficiency).slice(-3).join();
    figures.push(['rates', rates, [charts.design.declare_within, percent(charts.declared_wrongly), percent(charts.declared_rightly)].join()]);
    const scores = await page.locator('svg.monitor circle title').allTextContents();
    const path = charts.path.filter(Boolean);
    figures.push(['chart', scores.map(text => figuresIn(text).join(': ')).sort().join(), path.map(one => `${one.session}: ${three(one.score)}`).sort().join()]);
  }
  return figures;
}

async function ofGroups() {
  const [groups, cohorts] = [await all('groups'), await all('cohorts')];
  const [first, second] = [page.locator('table').first(), page.locator('table').nth(1)];
  const counts = table => cells(table).then(rows => new Map(rows.map(row => [row[0], row])));
  const [shown, compared] = [await counts(first), await counts(second)];
  return [...groups.map(one => [one.name, shown.get(one.name)?.[1], String(one.trainees.length)]),
    ...cohorts.map(one => [one.name, compared.get(`${one.name}${one.code}`)?.[2], String(one.people)])];
}

async function ofGroup() {
  const told = await rest(`groups/${session.group}/progress?task=${session.task.id}`);
  const rows = new Map((await cells(page.locator('.group-table'))).map(row => [row[0], row]));
  return told.rows.flatMap(row => {
    const name = told.trainees.find(one => one.id === row.trainee).name;
    const newest = row.points.at(-1);
    const value = !newest ? '–' : newest.low === null ? three(newest.value) : withError(newest.value, newest).join(' ± ');
    return [[`${name}, value`, rows.get(name)?.[2], value], [`${name}, sessions`, rows.get(name)?.[5], String(row.sessions)]];
  });
}

async function ofTask() {
  const at = `tasks/${session.task.id}`;
  const [standard] = (await rest(`${at}/standards`)).items;
  const figures = [];
  if (standard) {
    const card = page.locator('.card', { has: page.locator('#standard-in-use') });
    figures.push(['version', figuresIn(await card.locator('p').first().innerText())[0], String(standard.version)]);
    (await cells(card.locator('table'))).forEach((row, i) => {
      const { limit, low, high } = standard.targets[i];
      figures.push([row[0], figuresIn(row[1]).join(), [limit, ...(low === null ? [] : [low, high])].map(three).join()]);
    });
    const { rule, charts } = standard;
    const said = await facts(card.locator('dl.facts'));
    figures.push(['design', figuresIn(said.Chart).join(),
      [percent(charts.inadequate), percent(charts.adequate), charts.declare_within, percent(charts.false_declaration)].join()]);
    if (rule) figures.push(['rule', figuresIn(said['Pass rule']).join(), [rule.in_a_row, rule.then_more, rule.at_most].filter(Boolean).join()]);
  }
  const target = standard?.targets[0];
  const asked = new URLSearchParams({ feature: target?.feature ?? 'duration', ...(target?.tool && { tool: target.tool, hand: target.made_from?.handedness ?? 'right' }) });
  if (target) asked.set('limit', target.limit);
  const spread = await rest(`${at}/distribution?${asked}`);
  const plot = page.locator('svg.spread');
  const [{ values, keeping, withheld }] = spread.groups;
  if (values.length) {
    await plot.waitFor();
    const dots = await plot.locator('circle title').allTextContents();
    figures.push(['dots', dots.map(text => figuresIn(text)[0]).join(), values.map(three).join()]);
    const said = await page.locator('.slide + ul').innerText();
    const told = keeping ? [keeping.seen, keeping.low, keeping.high, keeping.expected].map(percent) : withheld ? figuresIn(withheld.detail) : [];
    figures.push(['share', figuresIn(said).join(), told.join()]);
  }
  const [model] = (await rest(`${at}/models`)).items;
  if (model && !model.withdrawn_at && model.report.knows) {
    const { value, low, high, people } = model.report.accuracy;
    const said = await page.locator('.card', { has: page.getByRole('heading', { name: 'Model of skill' }) }).locator('.body').innerText();
    figures.push(['model', figuresIn(said).join(), [model.version, ...[value, low, high].map(wholePercent), people].join()]);
  }
  return figures;
}

async function ofBoxes() {
  const rows = new Map((await cells(page.locator('table'))).map(row => [row[0], row[1]]));
  const boxes = (await all('boxes')).filter(box => box.calibration);
  return boxes.map(box => [box.name, rows.get(box.name), Number.isFinite(box.calibration.rms_px) ? `RMS ${three(box.calibration.rms_px)} px` : 'Given as a file']);
}

async function ofBox() {
  const at = `boxes/${session.box.id}`;
  const [camera, palettes, tests] = [await rest(`${at}/camera`), await all(`${at}/palette`), await all(`${at}/self-tests`)];
  const card = name => page.locator('section.card', { has: page.getByRole('heading', { level: 2, name, exact: true }) });
  const said = await facts(card('Camera').locator('dl.facts').first());
  const figures = [
    ['residual', said['Residual (RMS)'], Number.isFinite(camera.rms_px) ? `${three(camera.rms_px)} px` : '–'],
    ['picture', said.Picture, `${camera.width} × ${camera.height}`],
    ['focal length', said['Focal length'], `${three(camera.fx)} × ${three(camera.fy)} px`],
    ['principal point', said['Principal point'], `${three(camera.cx)}, ${three(camera.cy)} px`],
  ];
  const [tapes, counts] = [await cells(card('Tape colours').locator('table').first()), await cells(card('Tape colours').locator('table').nth(1))];
  palettes[0].tools.forEach((tool, i) => figures.push([tool.name, tapes[i].slice(-2).join(),
    [`${three(tool.diameter_mm)} mm`, tool.band_length_mm ? `${three(tool.band_length_mm)} mm` : '–'].join()]));
  palettes[0].counts.forEach((one, i) => figures.push([`samples of ${one.label}`, counts[i][1], String(one.samples)]));
  if (tests[0]?.holds.length) {
    const mm = value => (value === null ? '–' : written(fixed(value, 2)));
    (await cells(card('Self-test').locator('table'))).forEach((row, i) => {
      const { from_s, error_mm, along_mm, across_mm } = tests[0].holds[i];
      figures.push([`rest ${i}`, [row[1], ...row.slice(3, 6)].join(), [fixed(from_s, 1), ...[error_mm, along_mm, across_mm].map(mm)].join()]);
    });
  }
  return figures;
}

async function ofService() {
  const told = await rest('service');
  const { version, pipeline, storage, queue, settings } = told;
  const said = Object.assign({}, ...(await Promise.all((await page.locator('dl.facts').all()).map(facts))));
  const all = await Promise.all((await page.locator('dl.facts').all()).map(facts));
  const [kept] = all.filter(one => 'Database' in one);
  const figures = [
    ['version', said.Program, version], ['pipeline', said['Measures as version'], pipeline],
    ['files', figuresIn(kept['Recordings and results']).join(), [bytes(storage.files_bytes).split(' ')[0], storage.files].join()],
    ['waiting', said.Waiting, String(queue.queued)], ['quarantined', said['Set aside after crashes'], String(queue.quarantined)],
    ['largest', said['Largest recording'], bytes(settings.max_upload_bytes)], ['workers', said['Recordings tracked at once'], String(settings.workers)],
    ['erased', figuresIn(said['What was erased has left the disk'])[0], String(settings.erased_within_s)],
    ['unfinished', figuresIn(said['Unfinished uploads are forgotten'])[0], String(settings.unfinished_upload_h)],
    ['sign-in', figuresIn(said['A sign-in ends']).join(), [settings.idle_min, settings.sign_in_h].join()],
    ['attempts', figuresIn(said['Attempts to sign in'])[0], String(settings.attempts_per_min)],
  ];
  const changes = (await rest('audit?limit=25')).items;
  (await cells(page.locator('table'))).forEach((row, i) =>
    figures.push([`change ${i}`, row.slice(2).join(), [`${changes[i].action} ${changes[i].noun}`, changes[i].called ?? changes[i].subject].join()]));
  return figures;
}

async function ofSessionReport() {
  const { features } = await rest(`sessions/${session.id}`);
  const measured = one => `${one.error ? withError(one.value, one.error).join(' ± ') : `${three(one.value)} (error not known)`}${['', '1'].includes(one.unit) ? '' : ` ${one.unit}`}`;
  const judged = await cells(page.locator('table.targets'));
  const figures = features.filter(one => one.target && one.value !== null).slice(0, judged.length)
    .map((one, i) => [one.title, judged[i].slice(1, 3).map(text => figuresIn(text).join()).join(), [three(one.target.limit), figuresIn(measured(one)).join()].join()]);
  const head = await page.locator('table.values thead th').allInnerTexts();
  for (const row of await cells(page.locator('table.values')))
    row.slice(1).forEach((shown, i) => {
      const one = features.find(of => of.title === row[0] && of.space === '3d' && (of.tool ?? 'Session') === head[i + 1]);
      if (one?.value !== null && one) figures.push([`${row[0]}, ${head[i + 1]}`, shown, measured(one)]);
    });
  return figures;
}

const day = iso => new Intl.DateTimeFormat('en-US', { dateStyle: 'medium' }).format(new Date(iso));

async function ofCertificate() {
  const { standard, passed, rule, sessions, trainee, task, pipeline } = await rest(`trainees/${pass.trainee}/progress?task=${pass.task}`);
  const paper = page.locator('.certificate');
  const [, , said, set] = await paper.locator(':scope > p').allInnerTexts();
  const made = await facts(paper.locator('.provenance dl'));
  const rows = await cells(paper.locator('table'));
  const targets = await paper.locator('li').allInnerTexts();
  const asked = [rule?.in_a_row, rule?.then_more || null, rule?.at_most].filter(value => value !== null && value !== undefined);
  return [
    ['rule', figuresIn(said.replace(task.name, '')).join(), passed.by === 'rule' ? asked.join() : ''],
    ['passed at', set.includes(day(passed.at)), true],
    ['version', figuresIn(set.replace(day(passed.at), ''))[0], String(standard.version)],
    ...standard.targets.map(({ limit }, i) => [`target ${i}`, figuresIn(targets[i].split(':').at(-1))[0], three(limit)]),
    ['sessions', rows.map(row => row.slice(0, 2).join(' ')).join('; '),
      sessions.filter(one => passed.sessions.includes(one.number)).map(one => `${one.number} ${day(one.recorded_at)}`).join('; ')],
    ['pipeline', made.Program, pipeline], ['trainee', made.Trainee, trainee.id], ['task', made.Task, task.id],
  ];
}

async function ofTraineeReport() {
  const told = await rest(`trainees/${session.trainee.id}/progress?${progress}`);
  const series = told.features.slice(0, 3);
  const about = await facts(page.locator('.report dl.about'));
  const counted = told.sessions.filter(one => !one.set_aside).length;
  const figures = [['sessions', figuresIn(about.Sessions).join(), [told.earlier + told.sessions.length, counted].join()],
    ['period', about['From – to'], [...new Set([told.sessions[0], told.sessions.at(-1)].map(one => day(one.recorded_at)))].join(' – ')]];
  const last = told.sessions.slice(-14);
  const rows = await cells(page.locator('.report table'));
  figures.push(['rows', rows.length, last.length]);
  last.forEach((one, i) => {
    const measured = series.map(({ points, unit }) => {
      const point = points.find(({ session: number }) => number === one.number);
      if (!point || point.value === null) return '–';
      const value = point.low === null ? `${three(point.value)} (error not known)` : withError(point.value, point).join(' ± ');
      return `${value}${['', '1'].includes(unit) ? '' : ` ${unit}`}`;
    });
    figures.push([`session ${one.number}`, rows[i].slice(0, 2 + series.length).join('; '), [one.number, day(one.recorded_at), ...measured].join('; ')]);
  });
  const dots = await page.locator('.report svg.progress-plot circle.dot').count();
  figures.push(['dots', dots, series.flatMap(one => one.points).filter(point => point.value !== null).length]);
  return figures;
}

/** A trainee is shown their own recordings, and how many of them are where. */
async function ofOwnToday() {
  const counts = await Promise.all(['queued', 'tracking', 'failed'].map(async status => (await all(`sessions?status=${status}`)).length));
  const recent = (await all('sessions?status=done')).filter(one => Date.now() - Date.parse(one.created_at) < DAY_MS).length;
  await page.waitForFunction(() => !document.querySelector('.figures').textContent.includes('…'));
  const shown = await facts(page.locator('.figures'));
  return [['queued', shown['In the queue'], String(counts[0])], ['running', shown['Being tracked'], String(counts[1])],
    ['finished', shown['Scored of the last 24 h'], String(recent)], ['failed', shown['Could not be scored'], String(counts[2])]];
}

/** A page, what it shows, and an answer of REST with a change in it that the page must show. */
const pages = () => ({
  today: ['/', ofToday, '**/api/v1/sessions?status=failed*', told => told.items.push(...[0, 1].map(n => ({ id: `none-${n}`, status: 'failed' })))],
  sessions: ['/sessions', ofSessions, '**/api/v1/sessions?limit=50', told => (told.items.find(one => one.video.duration_s).video.duration_s += 1)],
  session: [`/sessions/${session.id}`, ofSession, `**/api/v1/sessions/${session.id}`, told => (told.features.find(one => one.value && one.space === '3d').value *= 1.01)],
  'session’s report': [`/sessions/${session.id}/report`, ofSessionReport, `**/api/v1/sessions/${session.id}`,
    told => told.features.filter(one => one.value && one.space === '3d').forEach(one => (one.value *= 1.01))],
  trainee: [`/trainees/${session.trainee.id}?${progress}`, ofTrainee, '**/progress?*', told => (told.features[0].points.find(one => one.value !== null).value *= 1.01)],
  'trainee’s report': [`/trainees/${session.trainee.id}/report?${progress}`, ofTraineeReport, '**/progress?*',
    told => (told.features[0].points.find(one => one.value !== null).value *= 1.01)],
  certificate: pass && [`/trainees/${pass.trainee}/certificate?task=${pass.task}`, ofCertificate, '**/progress?*', told => (told.standard.targets[0].limit += 1)],
  'own today': ['/', ofOwnToday, '**/api/v1/sessions?status=failed*', told => told.items.push({ id: 'none', status: 'failed' })],
  groups: ['/groups', ofGroups, '**/api/v1/cohorts?*', told => (told.items[0].people += 1)],
  group: [`/groups/${session.group}?task=${session.task.id}`, ofGroup, '**/progress?*', told => (told.rows.find(one => one.points.length).points.at(-1).value *= 1.01)],
  task: [`/tasks/${session.task.id}`, ofTask, '**/distribution?*', told => (told.groups[0].values[0] *= 1.01)],
  boxes: ['/boxes', ofBoxes, '**/api/v1/boxes?*', told => told.items.forEach(one => one.calibration && (one.calibration.rms_px = 0.987))],
  box: [`/boxes/${session.box.id}`, ofBox, '**/camera', told => (told.fx += 10)],
  service: ['/service', ofService, '**/api/v1/service', told => (told.settings.attempts_per_min += 1)],
});

before(async () => {
  browser = await launch();
  const we = await person(browser);
  ({ page, make, open } = we);
  await page.goto(`${url}/sessions`);
  await we.signIn();
  await we.heading('Sessions').waitFor();
  cookie = await cookieOf(page);
  const isWanted = one => one.source.kind === 'recording' && !one.set_aside && (!process.env.TROCAR_TASK || one.task.name === process.env.TROCAR_TASK);
  session = (await all('sessions?status=done')).find(isWanted);
  assert.ok(session, 'a scored recording');
  if (!(await all('cohorts')).length) await make('cohorts', { name: 'Everybody' });
  session.group = (await all('groups')).find(one => one.trainees.includes(session.trainee.id))?.id ?? (await groupOf(session.trainee));
  const [cohort] = await all('cohorts');
  progress = new URLSearchParams({ task: session.task.id, cohort: cohort.code }).toString();
  pass = await somePass();
});

after(() => browser?.close());

const cookieOf = async of => (await of.context().cookies()).map(({ name, value }) => `${name}=${value}`).join('; ');

/** Somebody who has passed a task; null where nobody has. */
async function somePass() {
  const done = await all('sessions?status=done');
  const pairs = new Map(done.map(({ trainee, task }) => [`${trainee.id} ${task.id}`, { trainee: trainee.id, task: task.id }]));
  for (const pair of pairs.values()) if ((await rest(`trainees/${pair.trainee}/progress?task=${pair.task}`)).passed) return pair;
  return null;
}

async function groupOf(trainee) {
  const { id } = await make('groups', { name: `With ${trainee.name}` });
  const headers = { cookie, 'content-type': 'application/json', origin: url };
  const body = JSON.stringify({ instructors: [], trainees: [trainee.id] });
  const answer = await fetch(`${url}/api/v1/groups/${id}/members`, { method: 'PUT', headers, body });
  assert.ok(answer.ok, await answer.text());
  return id;
}

const differing = figures => figures.filter(([, shown, told]) => shown !== told).map(([what, shown, told]) => `${what}: the page shows ${shown}, REST tells ${told}`);

/** Compares what a page shows with what REST tells, and shows it once more with an altered answer. */
async function compare(t, name) {
  if (!pages()[name]) return t.skip('nobody has passed in this centre');
  const [path, figuresOf, altered, change] = pages()[name];
  await open(path);
  const figures = await figuresOf();
  assert.ok(figures.length > 0, 'nothing to compare');
  assert.deepEqual(differing(figures), []);
  console.log(`${name}: ${figures.length} figures compared`);
  await page.route(altered, async route => {
    const answer = await route.fetch();
    const told = await answer.json();
    change(told);
    await route.fulfill({ response: answer, json: told });
  });
  await open(path);
  const noticed = differing(await figuresOf());
  await page.unroute(altered);
  assert.notEqual(noticed.length, 0, 'the comparison would notice nothing');
}

const PAGES = ['today', 'sessions', 'session', 'session’s report', 'trainee', 'trainee’s report', 'certificate', 'groups', 'group', 'task', 'boxes',
  'box', 'service'];
for (const name of PAGES)
  test(`${name}: what it shows is what REST tells, and an answer that was altered on its way is noticed`, t => compare(t, name));

test('a trainee’s own view: what it shows is what REST tells them, and an altered answer is noticed', async t => {
  const account = { login: `figures-${Date.now()}`, name: session.trainee.name, role: 'trainee', password: 'a password of a trainee', trainee: session.trainee.id };
  await make('people', account);
  const [ours, own] = [{ page, open, cookie }, await person(browser)];
  try {
    ({ page, open } = own);
    await page.goto(url);
    await own.signIn(account.password, account.login);
    await own.heading('Today').waitFor();
    cookie = await cookieOf(page);
    for (const name of ['own today', 'sessions', 'session', 'session’s report', 'trainee', 'trainee’s report']) await compare(t, name);
  } finally {
    await page.context().close();
    ({ page, open, cookie } = ours);
  }
});

test('a value’s place in a cohort stands under it, with its interval', async () => {
  const place = { session: 1, percentile: { value: 37.4, low: 12.2, high: 66.7 }, better_than: { value: 62.6, low: 33.3, high: 87.8 }, people: 14, error_known: true };
  const altered = '**/progress?*cohort=*';
  await page.route(altered, async route => {
    const answer = await route.fetch();
    const told = await answer.json();
    told.sessions = told.sessions.filter(one => one.id === session.id);
    for (const one of told.features) Object.assign(one, { place: one.better === 'neither' ? { ...place, better_than: null } : place, no_place: null });
    await route.fulfill({ response: answer, json: told });
  });
  await open(`/sessions/${session.id}`);
  const better = page.locator('.fourth td .place', { hasText: 'better than 63 % (33 – 88 %)' });
  await better.first().waitFor();
  assert.match(await better.first().getAttribute('title'), /^Better than 63 % \(33 – 88 %\) of 14 people of “/);
  await page.getByLabel('Place among').selectOption({ label: 'Nobody' });
  await better.first().waitFor({ state: 'detached' });
  await page.unroute(altered);
});

// What is shown live. No answer of REST stands behind it: what the page's own socket told last is what must stand there.

/** What the sockets of a page tell it, by session; `change` alters every word on its way. A line that is held lets through one more frame, which
 *  begins another second, and then pictures alone: the numbers stand still, and the page's clock says that they are the last frame's. */
async function overhear(of, change = () => {}) {
  const lines = new Map();
  await of.routeWebSocket(/\/sessions\/[^/]+\/live/, socket => {
    const line = { features: [], frame: null, isHeld: false, isOver: false };
    lines.set(new URL(socket.url()).pathname.split('/').at(-2), line);
    const service = socket.connectToServer();
    service.onMessage(data => {
      if (typeof data !== 'string') return socket.send(data);
      if (line.isOver) return;
      const word = JSON.parse(data);
      const isFrame = word.type === 'frame';
      if (line.isHeld && !(isFrame && isWhole(word) && secondsOf(word) > secondsOf(line.frame) && Date.now() > line.at + OFTEN_MS)) return;
      line.isOver = line.isHeld;
      if (isFrame) [line.frame, line.at] = [word, Date.now()];
      if (word.type === 'features') line.features = word.features;
      const altered = structuredClone(word);
      change(altered);
      socket.send(JSON.stringify(altered));
    });
  });
  return lines;
}

/** Numbers that come faster are not all written. */
const OFTEN_MS = 250;
const isWhole = frame => frame.tools.every(tool => tool.tip_mm);
const secondsOf = frame => Math.round(frame.time_s);

/** The line of a session, held, once it has told features and the page shows its last frame. */
async function held(lines, id, shown) {
  const isFollowed = line => line?.frame && line.features.some(one => one.name === 'path_length' && one.value !== null);
  await until(() => isFollowed(lines.get(id)), 'features so far');
  const line = lines.get(id);
  line.isHeld = true;
  await until(() => line.isOver, 'one more frame with every tool');
  await shown.filter({ hasText: clock(line.frame.time_s, 0) }).waitFor();
  await pause(OFTEN_MS); // The clock is written at once, the other numbers when their turn comes.
  return line;
}

async function ofLive(of, { frame, features }) {
  const figures = [];
  for (const [at, tool] of (await of.locator('.live-tool').all()).entries()) {
    const { tip_mm: tip, sigma_mm: [across, along], speed_mm_s: speed } = frame.tools[at];
    const told = [...tip.map((value, axis) => `${written(fixed(value, 1))} ± ${written(fixed(axis < 2 ? across : along, 1))} mm`), `${written(fixed(speed, 0))} mm/s`];
    const shown = await tool.locator('.position tr').evaluateAll(rows => rows.map(row => [...row.cells].slice(1).map(cell => cell.textContent).filter(Boolean).join(' ')));
    told.forEach((line, row) => figures.push([`tool ${at}, row ${row}`, shown[row], line]));
  }
  if (frame.distance_mm) {
    const [distance, sigma] = frame.distance_mm;
    figures.push(['distance', (await of.locator('.distance dd').innerText()).replace(/\s+/g, ' '), `${fixed(distance, 1)} ± ${fixed(sigma, 1)} mm`]);
  }
  const table = of.locator('.live-features');
  const tools = (await table.locator('thead th').allInnerTexts()).slice(1, -1);
  for (const [title, ...values] of await cells(table))
    tools.forEach((tool, at) => {
      const one = features.find(other => other.title === title && other.tool === tool);
      figures.push([`${title}, ${tool}`, values[at], one.value === null ? 'too little seen yet' : three(one.value)]);
    });
  return figures;
}

async function ofWall(of, { features }) {
  const tile = of.locator('.tile', { hasText: session.box.name });
  const rows = await tile.locator('li').evaluateAll(all => all.map(row => [row.querySelector('.tool').textContent, row.querySelector('.path').textContent]));
  return rows.map(([tool, shown]) => {
    const path = features.find(one => one.name === 'path_length' && one.tool === tool);
    return [`path of ${tool}`, figuresIn(shown).join(), path?.value === null ? '' : three(path.value)];
  });
}

test('while it arrives: the live page and the wall show what their sockets told last, and a word that was altered is noticed', async t => {
  const isPlayed = one => one.source.kind === 'recording' && one.task.id === session.task.id && one.filename !== 'live.mp4'; // Of a feed of JPEGs.
  const sent = (await all('sessions?status=done')).find(isPlayed);
  if (!sent) return t.skip('no recording here that a browser plays');
  const sender = await page.context().newPage();
  await sender.goto(url);
  const { trainee, task, box } = await rest(`sessions/${sent.id}`);
  const arriving = await beginFeed(sender, { recording: sent.id, box: box.code, trainee: trainee.code, task: task.code });
  const moved = word => word.type === 'frame' && word.tools.forEach(tool => tool.tip_mm && (tool.tip_mm[0] += 1));
  const farther = word => word.type === 'features' && word.features.forEach(one => one.value && (one.value *= 1.01));
  try {
    for (const [name, path, figuresOf, changes] of [['live page', `/sessions/${arriving}`, ofLive, [moved, farther]], ['wall', '/live', ofWall, [farther]]])
      for (const change of [undefined, ...changes]) {
        const watcher = await page.context().newPage();
        const lines = await overhear(watcher, change);
        await watcher.goto(url + path);
        const clockOf = name === 'wall' ? watcher.locator('.tile', { hasText: box.name }).locator('.elapsed') : watcher.locator('.elapsed');
        const figures = await figuresOf(watcher, await held(lines, arriving, clockOf));
        assert.ok(figures.length > 0, 'nothing to compare');
        if (change) assert.notEqual(differing(figures).length, 0, `${name}: the comparison would notice nothing`);
        else assert.deepEqual(differing(figures), []);
        if (!change) console.log(`${name}: ${figures.length} figures compared`);
        await watcher.close();
      }
  } finally {
    await endFeed(sender);
    await sender.close();
  }
});
