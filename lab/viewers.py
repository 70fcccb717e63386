#!/usr/bin/env python3
"""Puts a load of moving clients on `scree view`. Measures pictures per second, times, and the server's memory.

    lab/viewers.py PROGRAM FILE.scree [--clients 8] [--seconds 10] [--size 1280x720] [--join SECONDS]
                   [--link MBIT] [--delay MS] [options of scree view ...]

A client sends a camera every 16 ms and acknowledges each picture immediately. So this measures the server and the
loopback, without a browser. At the end all clients rest, and the times to a picture of full size and to a lossless one
are measured.
--join: after every SECONDS seconds a client leaves and another joins. Clients then also pick, hide nodes, request
screenshots and rest now and then.
--link: every client has a link of MBIT Mbit/s, with a buffer of 64 KiB and a delay of --delay ms (20) per direction.
The exit code is 1 if the server reports an error, closes a connection or ends, or if its memory grows from the second
to the last quarter of the time by more than 5% and 16 MiB.
"""
import argparse
import base64
import json
import math
import os
import queue
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time


class Link(threading.Thread):
    """A slow link to a server: its port takes one connection."""

    HELD = 64 * 1024  # size of the buffer, bytes

    def __init__(self, host, port, mbit, delay_ms):
        super().__init__(daemon=True)
        self.bytes_per_s, self.delay = mbit * 1e6 / 8, delay_ms / 1e3
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.server = socket.socket()
        self.server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self.HELD // 2)  # the kernel doubles it
        self.server.connect((host, port))
        self.start()

    def run(self):
        page, _ = self.listener.accept()
        for socket_ in (page, self.server):
            socket_.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for source, target in ((page, self.server), (self.server, page)):
            on_way = queue.Queue()
            threading.Thread(target=self.take, args=(source, on_way), daemon=True).start()
            threading.Thread(target=self.give, args=(on_way, target), daemon=True).start()

    def take(self, source, on_way):
        free_at = 0
        try:
            while data := source.recv(1400):
                free_at = max(free_at, time.perf_counter()) + len(data) / self.bytes_per_s
                on_way.put((free_at + self.delay, data))
                time.sleep(max(0, free_at - time.perf_counter()))
        except OSError:
            pass
        on_way.put((0, b""))

    def give(self, on_way, target):
        try:
            while True:
                due, data = on_way.get()
                time.sleep(max(0, due - time.perf_counter()))
                if not data:
                    target.shutdown(socket.SHUT_WR)
                    return
                target.sendall(data)
        except OSError:
            pass


class Client:
    """One viewer. `pictures`: (time, bytes) of each picture that arrived while the camera moved."""

    def __init__(self, host, port, token, size, seed, link=None):
        self.random = random.Random(seed)
        self.size = size
        self.turn = 2.4 * seed  # every client has its own viewpoint
        self.pictures, self.waits, self.problems = [], [], []
        self.times = {"shadowMs": [], "drawMs": [], "shadeMs": [], "encodeMs": [], "waitMs": []}
        self.scene, self.is_over = None, False
        self.sent = {}
        self.newest = None
        self.lock = threading.Lock()
        self.sharp = None  # milliseconds from the newest camera to the first full-size picture
        self.exact = None  # (bytes, milliseconds after its camera) of the newest lossless picture
        to = Link(host, port, *link).port if link else port
        self.socket = socket.create_connection((host, to), timeout=60)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET /ws HTTP/1.1\r\nHost: {host}:{port}\r\nOrigin: http://{host}:{port}\r\nUpgrade: websocket\r\n"
                             f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n").encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += self.take(1)
        if b" 101 " not in head:
            raise SystemExit(f"viewers.py: no WebSocket: {head[:80]}")
        self.send({"type": "hello", "token": token})
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def take(self, count):
        data = bytearray()
        while len(data) < count:
            part = self.socket.recv(count - len(data))
            if not part:
                raise ConnectionError("closed")
            data += part
        return bytes(data)

    def send(self, message):
        data = json.dumps(message).encode()
        mask = os.urandom(4)
        head = b"\x81" + (bytes([0x80 | len(data)]) if len(data) < 126 else b"\xfe" + struct.pack(">H", len(data)))
        with self.lock:
            self.socket.sendall(head + mask + bytes(byte ^ mask[i % 4] for i, byte in enumerate(data)))

    def read(self):
        message = b""
        try:
            while True:
                first, length = self.take(2)
                if length == 126:
                    length, = struct.unpack(">H", self.take(2))
                elif length == 127:
                    length, = struct.unpack(">Q", self.take(8))
                message += self.take(length)
                if first & 15 == 8:
                    raise ConnectionError(f"closed by the server: {message[-100:]}")
                if first & 15 == 9:
                    with self.lock:
                        self.socket.sendall(b"\x8a\x80\0\0\0\0")
                    message = b""
                if first & 0x80 and first & 15 < 8:
                    self.understand(message)
                    message = b""
        except (OSError, ConnectionError) as error:
            if not self.is_over:
                self.problems.append(str(error))

    def understand(self, message):
        if message[:1] == b"{":
            text = json.loads(message)
            if text["type"] == "scene":
                self.scene = text
            elif text["type"] == "error":
                self.problems.append(text.get("message", "an error"))
            return
        size, = struct.unpack("<I", message[:4])
        head = json.loads(message[4:4 + size])
        if head["kind"] == "screenshot":
            return
        self.send({"type": "ack", "frame": head["frame"]})
        now = time.perf_counter()
        if not head.get("exact"):
            self.pictures.append((now, len(message)))
            for name in self.times:
                self.times[name].append(head[name])
        wait = 1e3 * (now - self.sent[head["seq"]]) if head.get("seq") in self.sent else float("nan")
        is_newest = head.get("seq") == self.newest
        if self.sharp is None and head.get("scale") == 1 and is_newest:
            self.sharp = wait
        if head.get("exact"):
            self.exact = (len(message), wait) if is_newest else self.exact
        elif head.get("seq") in self.sent:
            self.waits.append(wait)

    def view(self, number, moving=True):
        """Sends camera number `number` of a path around the scene."""
        low, high = self.scene["boxMin"], self.scene["boxMax"]
        middle = [(a + b) / 2 for a, b in zip(low, high)]
        reach = 0.8 * math.dist(low, high)
        turn = self.turn + number / 60 + self.random.random() * 0.01
        eye = [middle[0] + reach * math.cos(turn), middle[1] + 0.4 * reach, middle[2] + reach * math.sin(turn)]
        self.sharp = None
        self.newest = number
        self.sent[number] = time.perf_counter()
        self.sent.pop(number - 200, None)
        self.send({"type": "view", "seq": number, "eye": eye, "target": middle, "up": [0, 1, 0], "fov": 45,
                   "width": self.size[0], "height": self.size[1], "show": "texture", "light": True,
                   "shadows": self.scene["shadows"], "ssao": False, "edl": False,
                   "edlStrength": 1, "edlRadius": 1, "background": "#20252d", "samples": 1, "moving": moving, "full": False})

    def close(self):
        self.is_over = True
        self.socket.close()


def resident(pid):
    with open(f"/proc/{pid}/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE")


def at(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, int(share * len(values)))] if values else float("nan")


def something_else(client, number):
    choice = client.random.randrange(5)
    pixel = {"x": client.random.randrange(client.size[0]), "y": client.random.randrange(client.size[1])}
    if choice == 0:
        client.send({"type": "pick", "id": number, **pixel})
    elif choice == 1:
        client.send({"type": "hide", "hidden": client.random.choice([[], [0]]), "only": []})
    elif choice == 2:
        client.send({"type": "screenshot", "id": number, "width": 320, "height": 200, "samples": 1})
    elif choice == 3:
        client.send({"type": "probe", **pixel})
    else:
        client.view(number, moving=False)
        time.sleep(0.3)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("file")
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--join", type=float, default=0)
    parser.add_argument("--link", type=float, default=0)
    parser.add_argument("--delay", type=float, default=20)
    options, words = parser.parse_known_args()
    size = tuple(map(int, options.size.split("x")))
    server = subprocess.Popen([options.program, "view", options.file, "--port", "0", *words], stdout=subprocess.PIPE, text=True)
    url = next(filter(None, (re.search(r"http://([\d.]+):(\d+)/\S*#token=(\w+)", line) for line in server.stdout)), None)
    if url is None:
        raise SystemExit("viewers.py: scree view printed no address")
    host, port, token = url.group(1), int(url.group(2)), url.group(3)
    seeds = iter(range(10**9))
    link = (options.link, options.delay) if options.link else None
    clients = [Client(host, port, token, size, next(seeds), link) for _ in range(options.clients)]
    gone, memory = [], []
    is_over = threading.Event()

    def move(place):
        number = 0
        while not is_over.is_set():
            client = clients[place]
            if client.scene is not None:
                number += 1
                try:
                    client.view(number)
                    if options.join and client.random.random() < 0.005:
                        something_else(client, number)
                except OSError as error:
                    if clients[place] is client and not client.is_over:
                        client.problems.append(str(error))
                        return
            time.sleep(0.016)

    movers = [threading.Thread(target=move, args=(place,), daemon=True) for place in range(options.clients)]
    for mover in movers:
        mover.start()
    deadline = time.perf_counter() + 60
    while any(not client.pictures for client in clients) and time.perf_counter() < deadline:
        time.sleep(0.05)
    time.sleep(1)
    start = time.perf_counter()
    next_join = start + options.join
    while time.perf_counter() - start < options.seconds and server.poll() is None:
        time.sleep(0.25)
        memory.append(resident(server.pid))
        if options.join and time.perf_counter() >= next_join:
            next_join += options.join
            place = random.randrange(options.clients)
            gone.append(clients[place])
            clients[place].is_over = True
            clients[place] = Client(host, port, token, size, next(seeds), link)
            gone[-1].close()
    end = time.perf_counter()
    is_over.set()
    for mover in movers:
        mover.join(2)
    for client in clients:
        client.exact = None
        client.view(10**6, moving=False)
    deadline = time.perf_counter() + 10
    while any(client.exact is None for client in clients) and time.perf_counter() < deadline:
        time.sleep(0.01)
    problems = [problem for client in clients + gone for problem in client.problems]
    if server.poll() is not None:
        problems.append(f"the server ended with {server.returncode}")
    for place, client in enumerate(clients):
        since = max(start, client.pictures[0][0] if client.pictures else end)
        shown = [size for when, size in client.pictures if since <= when < end]
        mean_kib = sum(shown) / 1024 / max(1, len(shown))
        print(f"client {place}: {len(shown) / max(0.001, end - since):.1f} pictures/s, {mean_kib:.0f} KiB each; "
              f"camera to picture {at(client.waits, 0.5):.1f} (95%: {at(client.waits, 0.95):.1f}) ms, on the server "
              + ", ".join(f"{name[:-2]} {at(times, 0.5):.2f}" for name, times in client.times.items())
              + (f"; sharp after {client.sharp:.0f} ms, lossless after {client.exact[1]:.0f}, {client.exact[0] / 1024:.0f} KiB"
                 if client.exact else ""))
        client.close()
    quarter = len(memory) // 4
    grown = at(memory[-quarter:], 0.5) - at(memory[quarter:2 * quarter], 0.5) if quarter else 0
    print(f"server: {at(memory, 0.5) / 2**20:.0f} MiB resident, {grown / 2**20:+.1f} MiB from the second to the last quarter, "
          f"{len(gone)} clients left, {len(problems)} problems")
    for problem in sorted(set(problems))[:10]:
        print("  ", problem)
    if server.poll() is None:
        server.send_signal(signal.SIGINT)
        server.wait(20)
    return 1 if problems or grown > max(16 << 20, 0.05 * at(memory, 0.5)) else 0


if __name__ == "__main__":
    sys.exit(main())
