// A worker thread for the connection and the pictures. It passes texts to the page and draws pictures on its canvas.
let canvas, context, socket, address, token;
let last = Promise.resolve();
let retryMs = 250, retryTimer = 0, isWanted = false;

const now = () => performance.timeOrigin + performance.now();
const tell = (type, content = {}) => postMessage({type, ...content});

const kReasons = {4001: 'token', 4002: 'full', 4003: 'refused', 4004: 'slow', 4005: 'busy', 4000: 'ended'};

function connect() {
  clearTimeout(retryTimer);
  isWanted = true;
  tell('state', {state: 'connecting', token});
  socket?.close();
  const opened = socket = new WebSocket(address);
  let isOpen = false;
  opened.binaryType = 'arraybuffer';
  opened.onopen = () => {
    if (opened !== socket) return opened.close();
    isOpen = true;
    retryMs = 250;
    tell('state', {state: 'open'});
    opened.send(JSON.stringify({type: 'hello', token}));
  };
  opened.onmessage = ({data}) => {
    if (opened !== socket) return;
    if (typeof data === 'string') return tell('text', {message: JSON.parse(data)});
    const picture = receive(data);
    last = last.then(async () => show(opened, await picture)).catch((error) => tell('trouble', {message: String(error)}));
  };
  opened.onclose = ({code}) => {
    if (opened !== socket) return;
    const reason = kReasons[code] ?? (isOpen ? 'lost' : 'unreachable');
    tell('state', {state: 'closed', reason, retryMs});
    if (reason === 'token' || reason === 'full' || reason === 'refused' || !isWanted) return;
    retryTimer = setTimeout(connect, retryMs);
    retryMs = Math.min(2 * retryMs, 4000);
  };
}

/// JPEG: WebCodecs is twice as fast, but available only in secure contexts. PNG: the bytes come back unchanged.
async function decode(bytes, type) {
  if (type === 'image/jpeg' && self.ImageDecoder) {
    const decoder = new ImageDecoder({data: bytes, type, colorSpaceConversion: 'none'});
    const {image} = await decoder.decode();
    decoder.close();
    return image;
  }
  return createImageBitmap(new Blob([bytes], {type}), {colorSpaceConversion: 'none', premultiplyAlpha: 'none'});
}

function acknowledge(from, {frame}) {
  if (from.readyState === WebSocket.OPEN) from.send(JSON.stringify({type: 'ack', frame}));
}

/// Decoding begins at once, while the previous picture is being drawn.
async function receive(data) {
  const headBytes = new DataView(data).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, headBytes)));
  const picture = {head, bytes: new Uint8Array(data, 4 + headBytes), arrived: now()};
  if (head.kind === 'screenshot') return picture;
  picture.image = decode(picture.bytes, head.kind === 'png' ? 'image/png' : 'image/jpeg').finally(() => { picture.decoded = now(); });
  picture.image.catch(() => {});  // show() handles the error
  return picture;
}

async function show(from, picture) {
  const {head, arrived} = picture;
  if (head.kind === 'screenshot') {
    const copy = picture.bytes.slice().buffer;
    return postMessage({type: 'screenshot', head, bytes: copy}, [copy]);
  }
  let image;
  try {
    image = await picture.image;
  } finally {  // a picture that cannot be decoded is acknowledged too
    if (!image) acknowledge(from, head);
  }
  if (canvas.width !== head.fullWidth || canvas.height !== head.fullHeight) {
    canvas.width = head.fullWidth;
    canvas.height = head.fullHeight;
  }
  context.imageSmoothingEnabled = head.width !== canvas.width;
  context.imageSmoothingQuality = 'low';
  context.drawImage(image, 0, 0, canvas.width, canvas.height);
  image.close();
  acknowledge(from, head);
  tell('frame', {head, bytes: picture.bytes.byteLength, arrived, decodeMs: picture.decoded - arrived, shown: now()});
}

onmessage = ({data}) => {
  switch (data.type) {
    case 'start':
      canvas = data.canvas;
      context = canvas.getContext('2d', {alpha: false});
      address = data.address;
      break;
    case 'connect':
      token = data.token;
      connect();
      break;
    case 'send':
      if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(data.message));
      break;
    case 'read':  // the pixels, for tests: RGBA
      last = last.then(() => {
        const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
        postMessage({type: 'pixels', width: canvas.width, height: canvas.height, pixels: pixels.data.buffer}, [pixels.data.buffer]);
      });
      break;
    case 'drop':  // for tests: as if the connection was lost
      socket?.close();
      break;
  }
};
