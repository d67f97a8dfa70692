// What stands in the way of people who hear a page, or use it with keys alone, by axe-core's rules.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';

const axe = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');
const GRAVE = ['serious', 'critical'];

/** The grave violations of what the page shows now, a line each. */
export async function violationsOf(page) {
  if (!(await page.evaluate(() => 'axe' in window))) await page.evaluate(axe);
  const { violations } = await page.evaluate(() => window.axe.run(document, { resultTypes: ['violations'] }));
  const line = ({ id, impact, help, nodes }) =>
    `${impact} ${id}: ${help} (${nodes.length}, such as ${nodes[0].target.join(' ')}: ${nodes[0].failureSummary})`;
  return violations.filter(({ impact }) => GRAVE.includes(impact)).map(line);
}
