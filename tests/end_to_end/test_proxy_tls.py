# SPDX-License-Identifier: GPL-3.0-or-later
"""Tokens through the proxy of deploy/replicas, and TLS before and behind it, with certificates that the openssl tool makes."""

import hashlib
import shutil
import unittest

from harness import AHMED_SETUP, main
from replicas import BehindProxy
from test_identity import Authority

SERVER_NAME = "deformd.example.org"


@unittest.skipUnless(shutil.which("haproxy"), "haproxy is not installed")
class Encrypted(BehindProxy):
    """The servers and the proxy have certificates of one authority; the proxy reaches servers by addresses that are in none."""

    def options_of(self, number):
        if number == 0:
            self.authority = Authority(self.folder, "test")
            self.authority.issue("server", f"DNS:{SERVER_NAME}")
            self.authority.issue("proxy", "IP:127.0.0.1")
            with open(self.path("proxy.pem"), "a") as both, open(self.path("proxy.key")) as key:
                both.write(key.read())
            lines = []
            for role in ("reader", "user"):
                token = f"{role}-secret-of-this-test"
                self.write(f"{role}.token", token + "\n")
                lines.append(f"{role} {role} sha256:{hashlib.sha256(token.encode()).hexdigest()}\n")
            self.write("identities", "".join(lines))
        return [*super().options_of(number), "--tls-cert", self.path("server.pem"), "--tls-key", self.path("server.key"),
                "--identities", self.path("identities")]

    def proxy_settings(self):
        return {"DEFORMD_PROXY_CERT": self.path("proxy.pem"), "DEFORMD_CA": self.path("test-ca.pem"), "DEFORMD_SERVER_NAME": SERVER_NAME}

    def environment(self):
        return {**super().environment(), "DEFORM_CA": self.path("test-ca.pem"), "DEFORM_TOKEN_FILE": self.path("user.token")}

    def test_who_may_what(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform("--ca", "test-ca.pem", "--token-file", "user.token", "apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "out.obj")
        self.deform("--token-file", "reader.token", "list")
        self.deform("sample", "-o", "other.obj", "--points", 3000)
        self.fails(1, "--token-file", "reader.token", "register", "other.obj", says=["needs the role user, \"reader\" has reader", "request id"])
        self.write("wrong.token", "guessed\n")
        self.fails(1, "--token-file", "wrong.token", "list", says=["token"])
        self.assertTrue(any(" identity=user " in server.log_text() for server in self.servers))

    def test_a_client_verifies_the_proxy(self):
        Authority(self.folder, "stranger")
        self.fails(1, "--ca", "stranger-ca.pem", "status", says=["from the authority \"CN=test\"", "not in stranger-ca.pem"])

    def test_the_proxy_verifies_the_servers(self):
        self.restart_proxy(DEFORMD_SERVER_NAME="other.example.org")
        self.wait_until(lambda: self.deform("status", expect=None).code == 3, "the proxy answers that it has no server")
        self.fails(3, "status", says=["a proxy answers", "503"])
        Authority(self.folder, "stranger")
        self.restart_proxy(DEFORMD_CA=self.path("stranger-ca.pem"))
        self.fails(3, "status", says=["a proxy answers", "503"])
        self.restart_proxy()
        self.deform("status")

    def restart_proxy(self, **settings):
        self.stop_proxy()
        self.launch_proxy(**settings)
        self.wait_until(lambda: "503" in (done := self.deform("status", expect=None)).err or done.code == 0, "haproxy answers")


if __name__ == "__main__":
    main()
