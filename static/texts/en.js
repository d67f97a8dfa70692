// Every word that the pages say, in English. Functions where a word depends on a value.
const plural = (n, one, many) => `${n} ${n === 1 ? one : many}`;

export default {
  product: 'Trocar',
  skip: 'Skip to the content',
  loading: 'Loading …',
  retry: 'Try again',
  nav: { label: 'Pages', own: 'My progress', today: 'Today', sessions: 'Sessions', upload: 'Upload', trainees: 'Trainees', tasks: 'Tasks', boxes: 'Boxes', people: 'People' },
  roles: { administrator: 'Administrator', instructor: 'Instructor', trainee: 'Trainee' },
  theme: { label: next => `Change to ${next} colours`, system: 'the system’s', light: 'light', dark: 'dark' },
  live: { open: 'Live', connecting: 'Connecting', polling: 'Reconnecting – refreshed every 5 s', closed: 'Not connected' },

  problems: {
    answered: status => `The service answered with an error (${status})`,
    answeredDetail: 'Try again. If it stays, tell the person who runs this service, with the time of day.',
    offline: 'The service cannot be reached',
    offlineDetail: 'Check the network connection of this device, then try again. Nothing that was saved is lost.',
    broken: 'This page ran into a fault',
    brokenDetail: 'Load it again. If it stays, tell the person who runs this service what you were doing.',
    dismiss: 'Dismiss this message',
  },
  notFound: { title: 'There is no such page', body: 'The address may be mistyped, or the thing was deleted.', action: 'Go to Today' },

  signIn: { title: 'Sign in', login: 'Sign-in name', password: 'Password', submit: 'Sign in', busy: 'Signing in …', lead: 'Motion scores for laparoscopic training', again: 'You were signed out. Sign in to go on where you were.' },
  account: { title: 'Your account', signOut: 'Sign out', name: 'Name', login: 'Sign-in name', role: 'Role', password: 'Change the password', old: 'Old password', fresh: 'New password', freshHint: 'At least 10 characters; a sentence is good.', again: 'New password, again', differ: 'The two new passwords differ. Type both again.', change: 'Change the password', changed: 'The password is changed.' },

  status: { receiving: 'Receiving', queued: 'Queued', tracking: 'Tracking', done: 'Done', failed: 'Failed', quarantined: 'Set aside' },
  kinds: { track: 'Tracking a recording', calibrate: 'Calibrating a camera', palette: 'Learning tape colours' },
  jobStates: { queued: 'Queued', running: 'Running', done: 'Done', failed: 'Failed', quarantined: 'Set aside' },

  today: {
    title: 'Today', lead: 'What is being scored now, what is new and what needs a person.',
    queued: 'In the queue', running: 'Being tracked', finished: 'Finished in 24 h', attention: 'Need attention',
    moving: 'Queue', attentionTitle: 'Needs attention', recent: 'New results', position: n => (n > 1 ? `Number ${n} in the queue` : 'Next in the queue'),
    emptyQueue: 'Nothing is waiting', emptyQueueBody: 'Recordings appear here while they are being scored.',
    emptyAttention: 'Nothing needs attention', emptyAttentionBody: 'Recordings that could not be scored would be listed here, with what to do.',
    emptyRecent: 'No results yet', emptyRecentBody: 'Upload a recording; its score appears here by itself.', upload: 'Upload recordings', all: 'All sessions',
    announce: (name, status) => `${name}: ${status}`,
  },

  upload: {
    title: 'Upload recordings', lead: 'A broken connection or a reload does not lose what was sent.',
    who: 'Trainee', what: 'Task', where: 'Box', choose: 'Choose …', when: 'Recorded at', whenHint: 'Left empty: each file’s own date.',
    drop: 'Drop recordings here', or: 'MP4, MOV, MKV, AVI or TS; several at once are fine', pick: 'Choose files', need: 'First choose trainee, task and box above.',
    missing: { trainee: 'There are no trainees yet.', task: 'There are no tasks yet.', box: 'There are no boxes yet.' }, make: 'Create one',
    list: 'Uploads', none: 'No uploads', noneBody: 'Choose trainee, task and box, then drop files above.',
    states: { waiting: 'Waiting', sending: 'Sending', paused: 'Paused', done: 'Arrived', failed: 'Stopped', lost: 'Interrupted' },
    lost: name => `The page was closed while “${name}” was being sent. Choose the same file again and it goes on where it stopped.`,
    again: 'Choose the file', wrongFile: name => `That is another file. Choose “${name}” with the same size.`,
    pause: 'Pause', resume: 'Resume', cancel: 'Cancel', clear: 'Remove from the list', open: 'Open the session', retry: 'Try again',
    sent: (sent, total) => `${sent} of ${total}`, left: time => `about ${time} left`, duplicate: 'This recording was here already; nothing was stored twice.', announce: (name, state) => `${name}: ${state}`,
    progress: name => `Sending ${name}`, cut: 'The connection broke', cutDetail: 'What has arrived is kept. Press “Try again” when the network is back.',
    forWhom: (trainee, task, box) => `${trainee} · ${task} · ${box}`, noTrainee: 'Your account is not linked to a trainee. Ask an instructor to link it.',
  },

  sessions: {
    title: 'Sessions', lead: 'Every recording, newest first.', trainee: 'Trainee', task: 'Task', box: 'Box', status: 'Status', any: 'All', recorded: 'Recorded', file: 'File', length: 'Length',
    more: 'Show more', none: 'No sessions', noneFiltered: 'No session fits these filters. Set one of them back to “All”.', noneBody: 'Upload a recording to see it here.', clear: 'Clear the filters', count: n => plural(n, 'session shown', 'sessions shown'),
  },

  session: {
    title: (trainee, task) => `${trainee} – ${task}`, recorded: 'Recorded', retry: 'Score it again', retryBusy: 'Queueing …', retried: 'The recording is queued again.',
    remove: 'Delete', removeTitle: 'Delete this session?', removeBody: 'The recording, its path and its features are erased. This cannot be undone.', removeYes: 'Delete for good', keep: 'Keep it',
    waiting: 'This recording is waiting to be scored', tracking: 'This recording is being tracked', receiving: 'This recording is still arriving', waitingBody: 'The page fills by itself; there is no need to reload it.',
    video: 'Recording', overlay: 'Overlay', show: { tip: 'Tips', borders: 'Borders', path: 'Path', depth: 'Depth' }, noVideo: 'This browser cannot play this recording’s format. Curves, path and features still work.',
    play: 'Play', pause: 'Pause', back: 'One frame back', forward: 'One frame on', rate: 'Speed', rateOf: r => `${r}×`, timeline: 'Position in the recording', clock: (now, all) => `${now} / ${all}`, frame: n => `frame ${n}`,
    full: 'Full screen', keys: 'Keys: space plays, , and . step one frame, ← and → one second.',
    span: 'Show', spans: { all: 'Whole recording', 20: '20 s', 5: '5 s' },
    curves: 'Position and speed', axis: { x: 'x, mm (right)', y: 'y, mm (down)', z: 'z, mm (depth)', speed: 'speed, mm/s' }, plotName: axis => `Curve of ${axis} over time. Use the position slider above to move through it.`, curvesHint: 'Click or drag in a curve to go to that moment. Dashed: predicted. Gap: not seen.',
    readouts: 'Values at this moment', tool: 'Tool', x: 'x mm', y: 'y mm', z: 'z mm', speed: 'mm/s', state: 'State', states: ['not seen', 'predicted', 'observed'], unseen: (tool, why) => `${tool} not seen${why ? `: ${why}` : ''}`,
    space: 'Path in space', spaceName: 'Path of the tool tips in three dimensions. Arrow keys turn it, plus and minus zoom, 0 resets.', spaceHint: 'Drag or use the arrow keys to turn, wheel or + − to zoom, 0 to reset.', views: { camera: 'Top', front: 'Front', side: 'Side' }, colourBy: 'Colour', by: { speed: 'By speed', tool: 'By tool' }, slow: '0', fast: v => `${v} mm/s`,
    features: 'Features', feature: 'Feature', unit: 'Unit', both: 'Both', space3d: 'In space', image: 'In the image', plane: 'Measured', notEnough: 'not enough', noFeatures: 'No features', noFeaturesBody: 'They appear when the recording has been scored.', download: 'Download the path', formats: { csv: 'CSV', json: 'JSON', parquet: 'Parquet' },
    quality: 'What was seen', observed: 'Observed', predicted: 'Predicted', missing: 'Not seen', frames: n => `${n} frames`, residual: px => `Border residual ${px} px`, why: 'Why it was not observed', shares: (o, p, m) => `${o} observed, ${p} predicted, ${m} not seen`,
    reasons: { no_marker_colour: 'no region of the tape’s colour', too_small: 'the coloured region is too small to measure', wrong_shape: 'the coloured region is not shaped like a band', borders_not_found: 'too little of a border was visible', impossible_pose: 'the borders do not fit a tube of the known diameter', tip_hidden: 'the end of the band is hidden or outside the picture', out_of_bounds: 'the position would be outside the box', gate_rejected: 'the position contradicts the tool’s motion' },
    versions: 'Made with', again: 'Score it again with the newest camera, colours and program', version: { pipeline: 'Program', calibration: 'Calibration', palette: 'Tape colours', model: 'Skill model' }, noneYet: 'none', file: 'File', size: 'Picture', length: 'Length', box: 'Box', score: 'Score', noPath: 'The path could not be loaded',
  },

  trainees: { title: 'Trainees', lead: 'The people whose recordings are scored.', add: 'Add a trainee', edit: 'Edit', name: 'Name', code: 'Code', codeHint: 'Short and unique, for file names and REST. Left empty: made from the name.', level: 'Level', levels: { novice: 'Novice', intermediate: 'Intermediate', expert: 'Expert' }, handedness: 'Dominant hand', hands: { right: 'Right', left: 'Left', both: 'Both' }, group: 'Group', unset: 'Not stated', none: 'No trainees yet', noneBody: 'Add the first one; recordings are uploaded for a trainee.', find: 'Find by name', removeBody: 'The account, all recordings and all results of this trainee are erased. This cannot be undone.' },
  trainee: { progress: 'Sessions over time', task: 'Task', tool: 'Tool', none: 'No scored sessions of this task', noneBody: 'Upload a recording, or choose another task.', spark: (title, n) => `${title} over ${plural(n, 'session', 'sessions')}`, table: 'Sessions', change: (percent, since) => `${percent} since ${since}`, noTasks: 'There are no tasks yet', noTasksBody: 'Create a task first; progress is shown per task.' },
  tasks: { title: 'Tasks', lead: 'The exercises that are recorded.', add: 'Add a task', edit: 'Edit', name: 'Name', code: 'Code', description: 'Description', none: 'No tasks yet', noneBody: 'Add the first exercise, for example the m-shaped wire.', sessions: 'Sessions' },

  boxes: { title: 'Boxes', lead: 'Training boxes, each with its camera and its tape colours.', add: 'Add a box', edit: 'Edit', name: 'Name', code: 'Code', view: 'Camera’s view', views: { top: 'From the top', side: 'From the side' }, auto: 'Find out by itself', notes: 'Notes', camera: 'Camera', palette: 'Tape colours', none: 'No boxes yet', noneBody: 'Add a box, calibrate its camera, then mark the tape colours.', calibrated: rms => `RMS ${rms} px`, given: 'Given as a file', notYet: 'Missing', ready: 'Ready', tools: 'Tools', setUp: 'Set up' },
  box: {
    needed: 'Before recordings of this box can be scored, it needs a camera and tape colours.', ready: 'This box is ready: recordings can be scored.',
    camera: 'Camera', noCamera: 'Not calibrated yet. Send photos of a checkerboard, or a camera.json.', rms: 'Residual (RMS)', picture: 'Picture', focal: 'Focal length', centre: 'Principal point', when: 'Calibrated', photos: 'Photos', photo: 'Photo', used: 'Used', left: 'Left out', reason: 'Reason', residual: 'Residual, px', photosUsed: (used, all) => `${used} of ${all} used`,
    calibrate: 'Calibrate from photos or a video', columns: 'Inner corners, across', rows: 'Inner corners, down', square: 'Side of a square, mm', files: 'Photos or one video of the checkerboard', filesHint: '15 to 20 photos, tilted, reaching into every corner of the picture.', send: 'Calibrate', put: 'Or use a camera.json', putHint: 'OpenCV’s convention: width, height, fx, fy, cx, cy, k1, k2, p1, p2, k3.', putSend: 'Use this file', saved: 'The camera is saved.', sending: 'Sending …', noFile: 'Choose a file first.', notJson: 'This file is not JSON. Choose a camera.json or annotations.json.', history: 'Earlier calibrations',
    palette: 'Tape colours', noPalette: 'Not learned yet. Send the annotations with the clip or the frames that they mark.', samples: 'Samples', label: 'Label', annotations: 'annotations.json', annotationsHint: 'Marked rectangles of each tape colour and of the background.', clip: 'The clip they mark', clipHint: 'The video named in the annotations; or send images of the frames instead.', frames: 'Or images of the frames', framesHint: 'One image per marked frame, with the frame’s number as the last number of the name.', learn: 'Learn the colours', learned: 'The tape colours are learned.', learnedAs: (version, when) => `Version ${version}, learned ${when}`, diameter: 'Diameter', band: 'Band length', noNumber: name => `“${name}” has no frame number in its name. Name it like frame_12.png.`,
    job: 'Progress', done: 'Done', failed: 'It did not work', version: 'Version',
  },
  people: { title: 'People', lead: 'Who may sign in, and as what.', add: 'Add a person', edit: 'Edit', login: 'Sign-in name', name: 'Name', role: 'Role', password: 'Password', passwordHint: 'At least 10 characters. Tell it the person once; they can change it.', newPassword: 'New password', newPasswordHint: 'Left empty: stays as it is.', trainee: 'Is the trainee', groups: 'Groups', none: 'Nobody yet', noneBody: 'Add the first person.', group: 'Groups', addGroup: 'Add a group', noGroups: 'No groups yet', noGroupsBody: 'An instructor sees the trainees of their groups.', members: 'Members', instructors: 'Instructors', tokens: 'Tokens for programs', addToken: 'Make a token', tokenOnce: 'Copy it now: it is shown only this once.', noTokens: 'No tokens', noTokensBody: 'A token lets a program or a box send recordings without a password.', expires: 'Expires', expiresHint: 'Left empty: does not expire.', box: 'For the box', remove: 'Delete', removeTitle: name => `Delete “${name}”?`, removeBody: 'This cannot be undone.', agent: 'Box agent', any: 'Any' },
  form: { save: 'Save', saving: 'Saving …', cancel: 'Cancel', close: 'Close', optional: 'optional', remove: 'Delete' },
  units: { none: '' },
};
