"""A server of ocean data on loopback by OPeNDAP (DAP 2.0), which answers at other addresses as ERDDAP does.

Written from the protocols' descriptions, with nothing of the clients that are tested.
"""

import json
import re
import struct
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote

import numpy as np

_TYPES = {"float64": "Float64", "float32": "Float32", "int32": "Int32", "int16": "Int16"}
_TYPES |= {"int8": "Byte", "uint8": "Byte"}
_PART = re.compile(r"\[(\d+)(?::(\d+))?(?::(\d+))?\]")


class DataServer(ThreadingHTTPServer):
    """Serves data sets by name, as they are in memory.

    Attributes:
        datasets: undecoded, by name.
        asked: the paths with queries that were asked for, in order.
        ill: what is wrong with answers whose path contains the key: a status, "cut" or "hang".
    """

    daemon_threads = True

    def __init__(self, datasets):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.datasets, self.asked, self.ill = datasets, [], {}
        self.released = threading.Event()

    @property
    def address(self):
        return f"http://127.0.0.1:{self.server_address[1]}"

    def handle_error(self, request, client_address):
        """Clients that gave up are no fault of the server."""


@contextmanager
def serving(**datasets):
    """A server that runs while the context lasts."""
    server = DataServer(datasets)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server
    finally:
        server.released.set()
        server.shutdown()
        thread.join()
        server.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: DataServer

    def log_message(self, *_):
        pass

    def do_GET(self):
        path, _, query = self.path.partition("?")
        query = unquote(query)
        self.server.asked.append(f"{path}?{query}" if query else path)
        ill = next((what for part, what in self.server.ill.items() if part in self.path), None)
        if ill == "hang":
            self.server.released.wait(20.0)
            return
        if isinstance(ill, int):
            self.answer(ill, b"Error { message = nothing; };", "text/plain")
            return
        try:
            body, kind = self.find(path, query)
        except (KeyError, ValueError):
            self.answer(404, b"not found", "text/plain")
            return
        self.answer(200, body, kind, cut=ill == "cut")

    def find(self, path, query):
        if path.startswith(("/dodsC/", "/erddap/griddap/")):
            name, _, what = path.rpartition("/")[2].rpartition(".")
            data = self.server.datasets[name]
            if path.startswith("/erddap/"):
                # Its data sets are variables that share all axes, and such a part comes as a grid with these.
                data = data[[one for one in data.data_vars if set(data[one].dims) == set(data.dims)]]
                query = re.sub(r"\b(\w+)\.\1\b", r"\1", query)
            if what == "das":
                return das(data).encode(), "text/plain"
            if what in ("dds", "dods"):
                parts = projections(data, query)
                head = dds(data, parts, name).encode()
                if what == "dds":
                    return head, "text/plain"
                body = b"".join(values_of(data, name, index) for name, index in parts)
                return head + b"\nData:\n" + body, "application/octet-stream"
            raise KeyError(what)
        raise KeyError(path)

    def answer(self, status, body, kind, cut=False):
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body[: len(body) // 2] if cut else body)


def projections(data, query):
    """Variables and their indices, of a query such as u[0:1:3][2][1:2:9],v."""
    if not query:
        return [(str(name), ...) for name in data.variables]
    found = []
    for part in query.split(","):
        name, _, _ = part.partition("[")
        slices = []
        for first, second, third in _PART.findall(part):
            start, stride, stop = int(first), 1, int(first)
            if third:
                stride, stop = int(second), int(third)
            elif second:
                stop = int(second)
            slices.append(slice(start, stop + 1, stride))
        shape = data[name.split(".")[-1]].shape
        if slices and len(slices) != len(shape):
            raise ValueError(part)
        if any(one.stop > size for one, size in zip(slices, shape, strict=False)):
            raise ValueError(part)
        found.append((name, tuple(slices) if slices else ...))
    return found


def is_grid(data, name):
    """Whether servers give a variable together with its axes, as they do where all have values."""
    return data[name].ndim > 1 and all(dim in data.variables for dim in data[name].dims)


def maps(data, name, index):
    """The axes of a variable and their indices."""
    whole = index if index is not ... else (slice(None),) * data[name].ndim
    return list(zip(data[name].dims, whole, strict=True))


def dds(data, parts, title):
    lines = ["Dataset {"]
    for name, index in parts:
        group, _, inner = name.partition(".")
        if inner:
            lines += ["  Structure {", declared(data, inner, index), f"  }} {group};"]
        elif is_grid(data, name):
            lines += ["  Grid {", "    ARRAY:", declared(data, name, index), "    MAPS:"]
            lines += [declared(data, dim, part) for dim, part in maps(data, name, index)]
            lines.append(f"  }} {name};")
        else:
            lines.append(declared(data, name, index))
    return "\n".join([*lines, f"}} {title};\n"])


def declared(data, name, index):
    values = data[name].values[index]
    shape = "".join(f"[{dim} = {size}]" for dim, size in zip(data[name].dims, values.shape, strict=True))
    return f"    {_TYPES[values.dtype.name]} {name}{shape};"


def values_of(data, name, index):
    group, _, inner = name.partition(".")
    own = xdr(data[inner or group].values[index])
    if inner or not is_grid(data, name):
        return own
    return own + b"".join(xdr(data[dim].values[part]) for dim, part in maps(data, name, index))


def das(data):
    lines = ["Attributes {"]
    for name in data.variables:
        lines += [f"    {name} {{", *(_attribute(*pair) for pair in data[name].attrs.items()), "    }"]
    lines += ["    NC_GLOBAL {", *(_attribute(*pair) for pair in data.attrs.items()), "    }", "}"]
    return "\n".join(lines) + "\n"


def _attribute(name, value):
    if isinstance(value, str):
        return f"        String {name} {json.dumps(value)};"
    value = np.asarray(value)
    return f"        {_TYPES[value.dtype.name]} {name} {value};"


def xdr(values):
    """An array as DAP 2 sends it; numbers shorter than four bytes as four, bytes padded."""
    values = np.asarray(values)
    if not values.ndim:
        return values.astype(_wide(values.dtype)).tobytes()
    count = struct.pack(">II", values.size, values.size)
    if values.dtype.itemsize == 1:
        return count + values.tobytes() + bytes(-values.size % 4)
    return count + values.astype(_wide(values.dtype)).tobytes()


def _wide(dtype):
    return {"f8": ">f8", "f4": ">f4"}.get(dtype.str[1:], ">i4")
