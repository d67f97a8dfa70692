// On the page for recording: recordings that were begun and whose sender is gone, such as a tab that was closed.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { useData, useThrottled } from '../../data.js';
import { clock } from '../../format.js';
import { useLive } from '../../live.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Notice } from '../page/notice.js';

const words = t.watch.interrupted;
const MAX_SHOWN = 5;

export function InterruptedRecordings() {
  const { data, reload } = useData(signal => api.sessions.page({ status: 'receiving', limit: MAX_SHOWN }, signal), []);
  useLive('session', useThrottled(reload, 700));
  useLive('resync', reload);
  const interrupted = (data?.items ?? []).filter(session => session.interruption);
  return interrupted.map(session => html`
    <${Notice} key=${session.id} tone="warn" title=${titleOf(session.interruption?.recorded_s ?? 0)}>
      <a href=${href(['sessions', session.id])}>${session.trainee?.name} · ${session.task?.name} · ${session.box?.name}</a><//>`);
}

const titleOf = recorded => (recorded > 0 ? words.at(clock(recorded, 0)) : words.title);
