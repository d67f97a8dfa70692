// A job that a form has started, watched until it ends.
import { html, useEffect, useState } from './preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { useLive } from '../live.js';
import { t } from '../texts.js';
import { Notice, ProblemNotice } from './notice.js';
import { ProgressBar } from './status.js';

const ENDED = ['done', 'failed', 'quarantined'];
const POLL_MS = 2_000;

/** The answer to a 202 names its job by id or holds it whole. */
export const jobIdOf = answer => answer?.job?.id ?? answer?.job ?? answer?.id;

/** Events tell at once; asking at intervals finds the end even where no event comes through. */
export function JobProgress({ id, done, onDone }) {
  const [job, setJob] = useState(null);
  const [problem, setProblem] = useState(null);
  const look = () => api.jobs.get(id).then(setJob, error => setProblem(asProblem(error)));
  const ended = ENDED.includes(job?.state);

  useLive(
    'job',
    event => event.id === id && (ENDED.includes(event.state) ? look() : setJob(before => ({ ...before, ...event }))),
  );
  useEffect(() => {
    look();
    if (ended) return undefined;
    const timer = setInterval(look, POLL_MS);
    return () => clearInterval(timer);
  }, [id, ended]);
  useEffect(() => {
    if (job?.state === 'done') onDone();
  }, [job?.state]);

  if (problem) return html`<${ProblemNotice} problem=${problem} />`;
  if (!job) return null;
  if (job.state === 'done') return html`<${Notice} tone="good" title=${done} />`;
  if (ended) return html`<${ProblemNotice} problem=${job.error ?? { title: t.box.failed }} />`;
  return html`
    <div class="stack tight" role="status">
      <span>${t.kinds[job.kind]}: ${t.jobStates[job.state]}</span>
      <${ProgressBar} value=${job.progress} name=${t.kinds[job.kind]} />
    </div>`;
}
