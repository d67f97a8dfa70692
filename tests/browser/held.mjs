// How long a page's own thread is busy without a pause, in time of the processor: a machine that does other things meanwhile makes
// a page wait, and nothing of that is the page's.

/** Runs `use()` and returns the longest tasks of the page meanwhile, ms, the longest first. */
export async function longestTasks(browser, page, use) {
  await browser.startTracing(page, { categories: ['toplevel'] });
  await use();
  const { traceEvents: events } = JSON.parse((await browser.stopTracing()).toString());
  const threads = new Set(events.filter(one => one.name === 'thread_name' && one.args.name === 'CrRendererMain').map(({ pid, tid }) => `${pid} ${tid}`));
  const tasks = events.filter(({ name, pid, tid, tdur }) => tdur && name.endsWith('RunTask') && threads.has(`${pid} ${tid}`));
  return tasks.map(({ tdur }) => Math.round(tdur / 1000)).sort((a, b) => b - a);
}
