// Whoever sits in front of the pages in a test: how they sign in, look, take pictures, and ask REST what any program may ask.
//
// Environment: TROCAR_URL, TROCAR_LOGIN, TROCAR_PASSWORD; optional TROCAR_SCREENSHOTS (a folder for pictures in all looks), TROCAR_CHROMIUM
// (/usr/bin/chromium), TROCAR_PATIENCE_S (how long a score may take, 180).
import assert from 'node:assert/strict';
import { mkdirSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';

import { LOOKS } from './chromium.mjs';
import { tracesOf } from './watch.mjs';

export const need = name => process.env[name] ?? assert.fail(`set ${name}: see the head of this file`);
export const url = need('TROCAR_URL').replace(/\/$/, '');
export const [login, password] = [need('TROCAR_LOGIN'), need('TROCAR_PASSWORD')];
export const patience = 1000 * Number(process.env.TROCAR_PATIENCE_S ?? 180);
const shots = process.env.TROCAR_SCREENSHOTS;
if (shots) mkdirSync(shots, { recursive: true });

export async function signIn(page, secret = password, name = login) {
  await page.fill('input[name=login]', name);
  await page.fill('input[name=password]', secret);
  await page.click('button[type=submit]');
}

/** The same request that any program may send, with the browser's sign-in. */
export const ask = (page, path) => page.evaluate(async at => (await fetch(at)).json(), `/api/v1/${path}`);

/** Makes what the path names, and returns what REST says of it. */
export const make = (page, path, json) =>
  page.evaluate(
    async ([at, body]) => {
      const answer = await fetch(at, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body });
      if (!answer.ok) throw new Error(`${at}: ${answer.status} ${await answer.text()}`);
      return answer.json();
    },
    [`/api/v1/${path}`, JSON.stringify(json)],
  );

async function wear(page, { colorScheme, viewport }) {
  await page.setViewportSize(viewport);
  await page.emulateMedia({ colorScheme });
}

/** How much wider the page is than the screen, pixels. */
const excess = page => page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);

/**
 * What the page shows now, in every look: nothing is wider than the screen, and `check(look)` may hold it to more. With
 * TROCAR_SCREENSHOTS a picture of each is kept.
 */
export async function looks(page, name, check = () => {}) {
  const viewport = page.viewportSize();
  for (const look of LOOKS) {
    await wear(page, look);
    await drawn(page); // Before, a curve has the width that another look left it.
    if (shots) {
      await page.evaluate(() => scrollTo(0, 0)); // The head of a page that was scrolled would stand in its middle.
      await page.screenshot({ path: join(shots, `${name}-${look.name}.png`), fullPage: true });
    }
    const over = await excess(page);
    assert.ok(over <= 0, `${name} is ${over} px wider than a ${look.name}`);
    await check(look);
  }
  await wear(page, { colorScheme: 'light', viewport });
}

/** The same at any moment of a scenario, and only where pictures are wanted: it takes seconds. */
export const picture = (page, name) => shots && looks(page, name);

/** What is drawn on canvases is drawn anew for another size and other colours: one in each frame. */
const drawn = page =>
  page.evaluate(() => new Promise(done => {
    let frames = 12;
    const next = () => (frames-- ? requestAnimationFrame(next) : done());
    next();
  }));

const A4_PX = { width: 794, height: 1123 };

/** The page on paper, as a PDF; with TROCAR_SCREENSHOTS it is kept, and a picture of the paper beside it. */
export async function printed(page, name) {
  const viewport = page.viewportSize();
  await page.emulateMedia({ media: 'print' });
  const pdf = await page.pdf({ preferCSSPageSize: true });
  if (shots) {
    writeFileSync(join(shots, `${name}-paper.pdf`), pdf);
    await page.setViewportSize(A4_PX);
    await drawn(page);
    await page.screenshot({ path: join(shots, `${name}-paper.png`), fullPage: true });
    await page.setViewportSize(viewport);
  }
  await page.emulateMedia({ media: 'screen' });
  return pdf;
}

/** Opens an address and waits until the page has what it shows. */
export async function open(page, path) {
  await page.goto(url + path);
  await page.locator('main h1').waitFor();
  await page.waitForFunction(() => !document.querySelector('main .loading'));
}

export async function until(holds, what) {
  const end = Date.now() + patience;
  while (!(await holds())) {
    assert.ok(Date.now() < end, `${what}: not in time`);
    await new Promise(done => setTimeout(done, 100));
  }
}

/** How many pages a PDF has: one object of the type Page for each. */
export const pagesOf = pdf => pdf.toString('latin1').match(/\/Type\s*\/Page\b(?!s)/g)?.length ?? 0;

/** Somebody with a page of their own, and the same as above with that page; `prefix` stands before the names of their pictures. */
export async function person(browser, { viewport = LOOKS[0].viewport, prefix = '' } = {}) {
  const context = await browser.newContext({ viewport, colorScheme: 'light' });
  const page = await context.newPage();
  return {
    page,
    traces: tracesOf(page, url),
    signIn: (secret, name) => signIn(page, secret, name),
    ask: path => ask(page, path),
    make: (path, json) => make(page, path, json),
    looks: (name, check) => looks(page, prefix + name, check),
    picture: name => picture(page, prefix + name),
    printed: name => printed(page, prefix + name),
    open: path => open(page, path),
    button: name => page.getByRole('button', { name, exact: true }),
    heading: words => page.locator('main h1', { hasText: words }),
  };
}
