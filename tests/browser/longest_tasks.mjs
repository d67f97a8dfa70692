// How long the page's main thread is busy without a pause, measured in CPU time: on a busy machine a page also waits
// for other processes, and that time does not count.

/** Runs `use()` and returns how long each task of the page's main thread took meanwhile, in ms, the longest first. */
export async function longestTasks(browser, page, use) {
  await browser.startTracing(page, { categories: ['toplevel'] });
  await use();
  const { traceEvents: events } = JSON.parse((await browser.stopTracing()).toString());
  const threads = new Set(events.filter(one => one.name === 'thread_name' && one.args.name === 'CrRendererMain').map(({ pid, tid }) => `${pid} ${tid}`));
  const tasks = events.filter(({ name, pid, tid, tdur }) => tdur && name.endsWith('RunTask') && threads.has(`${pid} ${tid}`));
  return tasks.map(({ tdur }) => Math.round(tdur / 1000)).sort((a, b) => b - a);
}
