// The progress of a job that a form has started, until it ends.
import { html, useEffect, useState } from '../../preact.js';
import { api, reportChange } from '../../api.js';
import { asProblem } from '../../data.js';
import { useLive } from '../../live.js';
import { t } from '../../texts.js';
import { Notice, ProblemNotice } from '../page/notice.js';
import { ProgressBar } from '../page/status.js';

const ENDED = ['done', 'failed', 'quarantined'];
const POLL_MS = 2_000;

/** The answer to a 202 contains the job's id or the whole job. */
export const jobIdOf = answer => answer?.job?.id ?? answer?.job ?? answer?.id;

/** Events report the end immediately; polling finds it even if no event arrives. */
export function JobProgress({ id, done, onDone }) {
  const [job, setJob] = useState(null);
  const [problem, setProblem] = useState(null);
  const fetchJob = () => api.jobs.get(id).then(setJob, error => setProblem(asProblem(error)));
  const hasEnded = ENDED.includes(job?.state);

  useLive(
    'job',
    event => event.id === id && (ENDED.includes(event.state) ? fetchJob() : setJob(before => ({ ...before, ...event }))),
  );
  useEffect(() => {
    fetchJob();
    if (hasEnded) return undefined;
    const timer = setInterval(fetchJob, POLL_MS);
    return () => clearInterval(timer);
  }, [id, hasEnded]);
  useEffect(() => {
    if (job?.state !== 'done') return;
    onDone();
    reportChange();
  }, [job?.state]);

  if (problem) return html`<${ProblemNotice} problem=${problem} />`;
  if (!job) return null;
  if (job.state === 'done') return html`<${Notice} tone="good" title=${done} />`;
  if (hasEnded) return html`<${ProblemNotice} problem=${job.error ?? { title: t.box.failed }} />`;
  return html`
    <div class="stack tight" role="status">
      <span>${t.kinds[job.kind]}: ${t.jobStates[job.state]}</span>
      <${ProgressBar} value=${job.progress} name=${t.kinds[job.kind]} />
    </div>`;
}
