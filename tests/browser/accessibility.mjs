// Finds accessibility violations with axe-core: obstacles for people who use a screen reader or only the keyboard.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';

const axe = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
const GRAVE = ['serious', 'critical'];

/** The serious and critical violations on the page as it is now, one string each. */
export async function violationsOf(page) {
  if (!(await page.evaluate(() => 'axe' in window))) await page.evaluate(axe);
  const { violations } = await page.evaluate(() => window.axe.run(document, { resultTypes: ['violations'] }));
  const line = ({ id, impact, help, nodes }) =>
    `${impact} ${id}: ${help} (${nodes.length}, such as ${nodes[0].target.join(' ')}: ${nodes[0].failureSummary})`;
  return violations.filter(({ impact }) => GRAVE.includes(impact)).map(line);
}
