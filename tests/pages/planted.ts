// Faults that the check must find: `tsc` reports each of these comments that no longer has an error below it.
import { api } from '../../static/api.js';
import { t } from '../../static/texts.js';

const session = await api.sessions.get('1');
// @ts-expect-error a misspelt field of an answer
session.featurs;
// @ts-expect-error a field that may be missing
session.quality.verdict;
// @ts-expect-error a value that the service never answers
session.status === 'finished';
// @ts-expect-error a missing field of a request
api.sessions.edit('1', { kind: 'trim' });
// @ts-expect-error a misspelt query parameter
api.tasks.distribution('1', { feature: 'duration', lmit: 1 });
// @ts-expect-error a missing argument
api.sessions.get();
// @ts-expect-error a missing argument of a text
t.certificate.setOn(1);
// @ts-expect-error a misspelt text
t.certificate.titel;
// @ts-expect-error a misspelt field of a component's property
(props: Props) => props.session.featurs;

// The same without the faults has no error.
[session.features, session.quality?.verdict, session.status === 'failed', api.sessions.get('1'), t.certificate.title];
