# SPDX-License-Identifier: GPL-3.0-or-later
"""TLS, client certificates, tokens and roles, with certificates that the openssl tool makes for each test."""

import hashlib
import os
import re
import shutil
import stat
import subprocess
import time

from harness import AHMED_SETUP, EndToEnd, Server, main

CA_CONFIG = """\
[ca]
default_ca = here
[here]
new_certs_dir = .
database = index.txt
serial = serial
default_md = sha256
policy = names
copy_extensions = copy
[names]
commonName = supplied
"""


class Authority:
    """Signs certificates; NAME.pem, NAME.key and NAME-ca.pem in a folder."""

    def __init__(self, folder, name):
        self.folder, self.name = folder, name
        self.run("req", "-x509", *self.new_key(name + "-ca"), "-out", f"{name}-ca.pem", "-days", "30", "-subj", f"/CN={name}")
        for file, text in ((f"{name}.cnf", CA_CONFIG), ("index.txt", ""), ("index.txt.attr", "unique_subject = no\n")):
            with open(os.path.join(folder, file), "w") as out:
                out.write(text)

    @staticmethod
    def new_key(name):
        return ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", f"{name}.key"]

    def run(self, *arguments):
        done = subprocess.run(["openssl", *arguments], cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            raise RuntimeError(done.stdout)

    def issue(self, name, names, start="20260101000000Z", end="20360101000000Z"):
        self.run("req", *self.new_key(name), "-out", f"{name}.csr", "-subj", f"/CN={name}", "-addext", f"subjectAltName={names}")
        self.run("ca", "-batch", "-notext", "-create_serial", "-config", f"{self.name}.cnf", "-cert", f"{self.name}-ca.pem",
                 "-keyfile", f"{self.name}-ca.key", "-in", f"{name}.csr", "-out", f"{name}.pem", "-startdate", start, "-enddate", end)

    def revoke(self, name):
        self.run("ca", "-config", f"{self.name}.cnf", "-cert", f"{self.name}-ca.pem", "-keyfile", f"{self.name}-ca.key",
                 "-revoke", f"{name}.pem")

    def list_revoked(self, days=30):
        """The list of now, beside its name and then in its place, as an authority's tools do."""
        self.run("ca", "-gencrl", "-config", f"{self.name}.cnf", "-cert", f"{self.name}-ca.pem", "-keyfile", f"{self.name}-ca.key",
                 "-crlsec", str(days * 86400), "-out", "new.crl")
        os.replace(os.path.join(self.folder, "new.crl"), os.path.join(self.folder, f"{self.name}.crl"))


class Identity(EndToEnd):
    here = "DNS:localhost,IP:127.0.0.1"
    tls = ("--tls-cert", "server.pem", "--tls-key", "server.key")

    def setUp(self):
        super().setUp()
        self.authority = Authority(self.folder, "test")
        self.authority.issue("server", self.here)

    def start_server(self, *options):
        """File names among the options are those of the folder of the test."""
        return super().start_server(*[self.path(o) if os.path.exists(self.path(o)) else o for o in options])

    def token(self, name):
        """A file with a token, and the hash for the file of identities."""
        token = f"{name}-secret-of-this-test"
        self.write(f"{name}.token", token + "\n")
        return "sha256:" + hashlib.sha256(token.encode()).hexdigest()

    def test_certificates(self):
        self.start_server(*self.tls)
        self.assertIn("serving", self.deform("--ca", "test-ca.pem", "status").out)
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform("apply", "setup.yaml", "--ca", "test-ca.pem", "--set", "roof_up=0.02", "-o", "out.obj")
        Authority(self.folder, "stranger")
        self.fails(1, "--tls", "status", says=["from the authority \"CN=test\"", "not in those that this machine trusts", "--ca"])
        self.fails(1, "--ca", "stranger-ca.pem", "status", says=["from the authority \"CN=test\"", "not in stranger-ca.pem"])
        self.fails(1, "status", says=[f"the server at {self.server.address} wants TLS", "--ca"])
        self.fails(1, "--ca", "test-ca.pem", "--server-name", "other.example", "status",
                   says=["is for localhost, 127.0.0.1, not for other.example", "--server-name"])
        self.deform("--ca", "test-ca.pem", "--server-name", "localhost", "status")
        self.fails(1, "--ca", "setup.yaml", "status", says=["setup.yaml", "no certificate in PEM"])
        self.fails(1, "--ca", "none.pem", "status", says=["none.pem", "No such file"])
        self.fails(1, "--ca", "test-ca.pem", "--cert", "server.pem", "status", says=["cert and key"])
        self.fails(1, "--ca", "test-ca.pem", "--cert", "server.pem", "--key", "test-ca.key", "status",
                   says=["test-ca.key", "does not belong to the certificate in server.pem"])

    def test_expired_and_early(self):
        self.authority.issue("server", self.here, start="20200101000000Z", end="20210102000000Z")
        self.start_server(*self.tls)
        self.assertIn("this certificate has expired", self.server.log_text())
        self.fails(1, "--ca", "test-ca.pem", "status", says=["expired on 2021-01-02 00:00 UTC", "the clock here says"])
        self.authority.issue("early", self.here, start="20450101000000Z", end="20460101000000Z")
        for kind in ("key", "pem"):
            os.replace(self.path(f"early.{kind}"), self.path(f"server.{kind}"))
        self.fails(1, "--ca", "test-ca.pem", "status", says=["is not valid before 2045-01-01 00:00 UTC"])

    def test_a_server_without_tls(self):
        self.start_server()
        self.fails(1, "--ca", "test-ca.pem", "status", says=["speaks plain text and no TLS"])
        self.server.stop()
        self.fails(3, "--ca", "test-ca.pem", "status", says=["cannot reach deformd"])

    def test_client_certificates(self):
        self.authority.issue("solver", "URI:spiffe://example.org/solver,DNS:solver.example.org")
        self.authority.issue("late", "DNS:late.example.org", start="20200101000000Z", end="20210102000000Z")
        self.authority.issue("unnamed", "DNS:unnamed.example.org")
        Authority(self.folder, "stranger").issue("foreign", "DNS:solver.example.org")
        self.write("identities", "solver reader certificate:solver.example.org\n")
        self.start_server(*self.tls, "--tls-client-ca", "test-ca.pem", "--identities", "identities")

        def shows(name):
            return ["--ca", "test-ca.pem", "--cert", f"{name}.pem", "--key", f"{name}.key"]

        self.deform(*shows("solver"), "list", "geometries")
        self.assert_logged(" identity=solver ")
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.fails(1, *shows("solver"), "register", "ahmed.obj", says=["needs the role user, \"solver\" has reader"])
        self.fails(1, "--ca", "test-ca.pem", "status", says=["wants a client certificate", "--cert"])
        self.fails(1, *shows("late"), "status", says=["does not accept the client certificate in late.pem", "expired on 2021-01-02"])
        self.fails(1, *shows("foreign"), "status", says=["does not accept", "foreign.pem", "\"CN=stranger\""])
        self.fails(1, *shows("unnamed"), "status", says=["no identity has the name", "unnamed.example.org"])

    def test_revoked_certificates(self):
        for name in ("solver", "other"):
            self.authority.issue(name, f"DNS:{name}.example.org")
        self.authority.list_revoked()
        self.start_server(*self.tls, "--tls-client-ca", "test-ca.pem", "--tls-client-crl", "test.crl")
        self.assertIn("revocations: 0 certificates in 1 lists", self.server.log_text())
        solver, other = (["--ca", "test-ca.pem", "--cert", f"{name}.pem", "--key", f"{name}.key"] for name in ("solver", "other"))
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.deform(*solver, "prepare", "setup.yaml")
        busy = {name: self.spawn(*who, "bench", "setup.yaml", "--designs", 50000, "--population", 1, "--json")
                for name, who in (("solver", solver), ("other", other))}
        self.wait_until(lambda: self.deform(*other, "status", "--json").json["designs_served"] > 10, "the clients are at work")
        self.authority.revoke("solver")
        self.authority.list_revoked()
        # The connection that is open loses its right, too.
        out, err = busy["solver"].communicate(timeout=60)
        self.assertEqual(busy["solver"].returncode, 1, out)
        self.assertIn("the certificate of CN=solver has been revoked", err)
        self.assertIsNone(busy["other"].poll(), "the other goes on")
        busy["other"].kill()
        self.fails(1, *solver, "status", says=["the certificate of CN=solver has been revoked"])
        self.deform(*other, "status")
        # A list that is cut off, of a stranger or gone changes nothing.
        Authority(self.folder, "stranger").list_revoked()
        with open(self.path("test.crl")) as file:
            good = file.read()
        with open(self.path("stranger.crl")) as file:
            foreign = file.read()
        for text, says in ((good[:200], "no list of revoked certificates"), (good + good[:200], "list 2 cannot be read"),
                           (foreign, "no authority in .*test-ca.pem has signed it")):
            self.write("test.crl", text)
            self.wait_until(lambda says=says: re.search(f"revocations: what was read before stays in force: .*{says}", self.server.log_text()),
                            "the log says so")
            self.fails(1, *solver, "status", says=["has been revoked"])
        os.remove(self.path("test.crl"))
        self.fails(1, *solver, "status", says=["has been revoked"])
        self.server.stop()
        with self.assertRaisesRegex(RuntimeError, "option tls-client-crl: .*test.crl"):
            self.server.start()

    def test_tokens_and_roles(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        names = {"ada": "reader", "ben": "user", "cleo": "operator"}
        self.write("identities", "".join(f"{name} {role} {self.token(name)}\n" for name, role in names.items()))
        self.start_server(*self.tls, "--identities", "identities", "--log-level", "trace")

        def says(name):
            return ["--ca", "test-ca.pem", "--token-file", f"{name}.token"]

        self.fails(1, "--ca", "test-ca.pem", "status", says=["asks who calls", "--token-file"])
        self.fails(1, *says("ada"), "register", "ahmed.obj", says=["RegisterGeometry needs the role user, \"ada\" has reader"])
        refused = self.fails(1, *says("ada"), "register", "ahmed.obj", "--json")
        self.assertEqual(refused.json["error"]["code"], "PERMISSION_DENIED")
        self.assertEqual(self.fails(1, "--ca", "test-ca.pem", "status", "--json").json["error"]["code"], "UNAUTHENTICATED")
        self.deform(*says("ben"), "apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "out.obj")
        geometry = self.deform(*says("ada"), "list", "geometries", "--json").json["geometries"][0]["id"]
        self.fails(1, *says("ben"), "remove", geometry, "--with-setups", says=["DeleteGeometry needs the role owner"])
        self.deform(*says("cleo"), "remove", geometry, "--with-setups")
        self.write("wrong.token", "not a known token")
        self.fails(1, *says("wrong"), "status", says=["wrong.token", "one token was expected"])
        self.write("wrong.token", "ada-secret-of-this-tesu")
        self.fails(1, *says("wrong"), "status", says=["the token is not known"])
        # The name in the file, another role: in force within two seconds.
        self.write("identities", f"ada operator {self.token('ada')}\n")
        time.sleep(2)
        self.fails(1, *says("ben"), "list", "geometries", says=["the token is not known"])
        self.fails(1, *says("ada"), "remove", geometry, says=["geometry"])
        log = self.server.log_text()
        self.assertIn("identity=ben", log)
        self.assertNotIn("secret-of-this-test", log)

    def tenants(self, *quotas):
        """Starts a server for ada of acme, bob of b-corp and carl of nobody in particular; returns how each calls."""
        owners = {"ada": " tenant=acme", "bob": " tenant=b-corp", "carl": ""}
        self.identities = "".join(f"{name} owner {self.token(name)}{tenant}\n" for name, tenant in owners.items())
        self.write("identities", self.identities + "".join(f"{line}\n" for line in quotas))
        self.start_server(*self.tls, "--identities", "identities")
        return [["--ca", "test-ca.pem", "--token-file", f"{name}.token"] for name in owners]

    def ids(self, who):
        return {kind: [entry["id"] for entry in self.deform(*who, "list", kind, "--json").json[kind]] for kind in ("geometries", "systems")}

    def test_tenants(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        ada, bob, carl = self.tenants()
        self.deform(*ada, "prepare", "setup.yaml")
        of_ada = self.ids(ada)
        self.assertEqual([len(ids) for ids in of_ada.values()], [1, 1])
        geometry, system = of_ada["geometries"][0], of_ada["systems"][0]
        nobody = "0" * 64
        for who in (bob, carl):
            self.assertEqual(self.ids(who), {"geometries": [], "systems": []})
            status = self.deform(*who, "status", "--json").json
            self.assertEqual((status["geometries"], status["setups"]), (0, 0))
            for what in (geometry, system, geometry[:12]):
                known = self.fails(1, *who, "remove", what, "--with-setups")
                unknown = self.fails(1, *who, "remove", nobody[:len(what)], "--with-setups")
                self.assertEqual(known.err.replace(what, "ID"), unknown.err.replace(nobody[:len(what)], "ID"))
        # The same content, registered by another in full: one copy on the disk, and each its own.
        self.deform(*bob, "apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "bob.obj")
        self.deform(*ada, "apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "ada.obj")
        with open(self.path("ada.obj"), "rb") as one, open(self.path("bob.obj"), "rb") as other:
            self.assertEqual(one.read(), other.read())
        self.assertEqual(self.ids(bob), of_ada)
        files = [os.path.join(self.server.data, "geometries", f"{geometry}.{tenant}") for tenant in ("acme", "b-corp")]
        self.assertTrue(os.path.samefile(*files))
        self.assert_logged(" identity=bob tenant=b-corp ")
        # Killed and without its catalog, the server knows whose everything is.
        self.server.kill()
        for file in os.listdir(self.server.data):
            if file.startswith("catalog.sqlite"):
                os.remove(os.path.join(self.server.data, file))
        self.server.start()
        self.assertEqual((self.ids(ada), self.ids(bob)), (of_ada, of_ada))
        self.assertEqual(self.ids(carl), {"geometries": [], "systems": []})
        self.deform(*ada, "remove", geometry, "--with-setups")
        self.assertEqual(self.ids(ada), {"geometries": [], "systems": []})
        self.assertEqual([os.path.exists(file) for file in files], [False, True])
        self.deform(*bob, "apply", "setup.yaml", "--set", "roof_up=0.02", "-o", "again.obj")
        with open(self.path("again.obj"), "rb") as one, open(self.path("bob.obj"), "rb") as other:
            self.assertEqual(one.read(), other.read())

    def test_quotas(self):
        self.write("setup.yaml", AHMED_SETUP)
        ada, bob, _ = self.tenants("tenant:acme geometries=1", "tenant:* stored-bytes=1GiB")
        for name, points in (("ahmed.obj", 2000), ("other.obj", 2500)):
            self.deform("sample", "-o", name, "--points", points)
        self.deform(*ada, "register", "ahmed.obj")
        self.deform(*ada, "register", "ahmed.obj")
        refused = self.fails(1, *ada, "register", "other.obj", "--json")
        self.assertEqual(refused.json["error"]["code"], "RESOURCE_EXHAUSTED")
        self.assertIn("quota geometries of tenant \"acme\": 1 are registered, the limit is 1", refused.json["error"]["message"])
        for name in ("ahmed.obj", "other.obj"):
            self.deform(*bob, "register", name)
        # Reread: within two seconds other limits are in force.
        self.write("identities", self.identities + "tenant:acme geometries=2\ntenant:b-corp requests-per-second=1\n")
        self.wait_until(lambda: self.deform(*ada, "register", "other.obj", expect=None).code == 0, "there is room for two")
        # The client waits as long as it is told to.
        for _ in range(4):
            self.deform(*bob, "list", "geometries")

    def test_certificates_that_nobody_can_show_are_warned_of(self):
        self.write("identities", f"ada reader {self.token('ada')}\nsolver user certificate:solver.example.org\n")
        self.start_server(*self.tls, "--identities", "identities")
        self.assertIn("1 of 2 are known by \"certificate:NAME\" alone, but without --tls-client-ca", self.server.log_text())
        self.server.stop()
        os.remove(os.path.join(self.folder, "deformd.log"))
        self.start_server(*self.tls, "--tls-client-ca", "test-ca.pem", "--identities", "identities")
        self.assertNotIn("without --tls-client-ca", self.server.log_text())

    def test_environment_and_plain_text(self):
        self.write("identities", f"ada reader {self.token('ada')}\n")
        self.start_server("--identities", "identities")
        self.deform("--token-file", "ada.token", "status")
        self.fails(1, "--server", "192.0.2.1:1", "--token-file", "ada.token", "status", says=["192.0.2.1:1", "plain text", "--tls"])
        self.server.stop()
        self.server.options += ["--tls-cert", self.path("server.pem"), "--tls-key", self.path("server.key")]
        self.server.start()
        own, self.environment = self.environment(), None
        self.environment = lambda: {**own, "DEFORM_SERVER": self.server.address, "DEFORM_CA": "test-ca.pem",
                                    "DEFORM_TOKEN_FILE": "ada.token"}
        self.deform("status")

    def test_contexts(self):
        """A server and its credentials under a name; an address by hand gets none of them."""
        self.write("identities", f"ada reader {self.token('ada')}\n")
        self.start_server(*self.tls, "--identities", "identities")
        named = {**self.environment(), "DEFORM_CONFIG": self.path("config/contexts.yaml")}
        address = named.pop("DEFORM_SERVER")
        self.environment = lambda: named
        self.assertIn("no contexts", self.deform("context", "list").out)
        self.fails(1, "context", "use", "a", says=["there is no \"a\"", "deform context add"])
        self.fails(1, "context", "add", "a", "--ca", "none.pem", says=["there is no file", "none.pem"])
        self.fails(1, "context", "add", "a b", says=["\"a b\" is no name"])
        self.fails(1, "context", "add", "a", "--server", "a.example.org", says=["a.example.org", "has no port"])
        self.deform("context", "add", "here", "--server", address, "--ca", "test-ca.pem", "--token-file", "ada.token")
        self.assertEqual(stat.S_IMODE(os.stat(self.path("config/contexts.yaml")).st_mode), 0o600)
        self.assertIn(f"at {address}", self.deform("status").out)
        self.deform("context", "add", "away", "--server", "127.0.0.1:1")
        self.assertIn("* here", self.deform("context", "list").out)
        self.fails(3, "--context", "away", "status", says=["127.0.0.1:1", "nobody listens"])
        self.deform("context", "use", "away")
        self.fails(3, "status", says=["127.0.0.1:1"])
        self.deform("--context", "here", "status")
        listed = self.deform("context", "list", "--json").json["contexts"]
        self.assertEqual([(c["name"], c["current"], c["server"]) for c in listed],
                         [("away", True, "127.0.0.1:1"), ("here", False, address)])
        self.deform("context", "use", "here")
        self.fails(1, "--server", address, "status", says=["wants TLS"])  # neither the authority nor the token of the context
        self.fails(1, "--server", address, "--ca", "test-ca.pem", "status", says=["asks who calls"])
        self.write("wrong.token", "wrong")
        self.fails(1, "--token-file", "wrong.token", "status", says=["the token is not known"])
        self.deform("context", "remove", "here")
        self.assertEqual([c["name"] for c in self.deform("context", "list", "--json").json["contexts"]], ["away"])
        self.write("config/contexts.yaml", "contexts:\n  a: {servre: b}\n")
        self.fails(1, "status", says=["contexts.yaml:2", "did you mean \"server\""])
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)  # needs no server

    def test_unix_socket(self):
        self.start_server()
        self.server.stop()
        self.write("identities", f"ada reader {self.token('ada')}\n")
        socket = self.path("socket")
        os.remove(self.path("port"))
        server = subprocess.Popen([os.environ["DEFORMD_BIN"], "--address", f"unix:{socket}", "--data-dir", self.path("data"),
                                   "--identities", self.path("identities"), "--port-file", self.path("port")],
                                  stderr=subprocess.DEVNULL)
        self.children.append(server)
        self.wait_until(lambda: os.path.exists(self.path("port")), "deformd has started")
        self.assertEqual(stat.S_IMODE(os.stat(socket).st_mode), 0o660)
        self.deform("--server", f"unix:{socket}", "--token-file", "ada.token", "status")
        self.fails(1, "--server", f"unix:{socket}", "status", says=["asks who calls"])

    def test_plain_text_beyond_this_machine_says_what_is_missing(self):
        self.server = Server(self.folder, "--insecure")
        self.server.host = "0.0.0.0"
        self.server.start()
        self.deform("--server", f"127.0.0.1:{self.server.port}", "status")
        self.assertRegex(self.server.log_text(), "warning insecure: .*Nothing is encrypted.*--tls-cert.*--identities")
        self.server.stop()
        self.server = Server(self.folder, "--tls-cert", self.path("server.pem"), "--tls-key", self.path("server.key"))
        self.server.host = "0.0.0.0"
        self.server.start()
        self.assertIn("nobody is asked who calls", self.server.log_text())

    def test_certificates_are_replaced_under_load(self):
        self.deform("sample", "-o", "ahmed.obj", "--points", 2000)
        self.write("setup.yaml", AHMED_SETUP)
        self.start_server(*self.tls)
        tls = ["--ca", "test-ca.pem"]
        self.deform(*tls, "prepare", "setup.yaml")
        busy = [self.spawn(*tls, "bench", "setup.yaml", "--designs", 2000, "--json") for _ in range(8)]
        for k in range(5):
            self.authority.issue(f"next{k}", self.here)
            # The certificate first: until its key is there, too, the old pair serves.
            shutil.copy(self.path(f"next{k}.pem"), self.path("server.pem"))
            self.deform(*tls, "status")
            shutil.copy(self.path(f"next{k}.key"), self.path("server.key"))
            self.deform(*tls, "status")
            self.assertIn(f"tls: certificate of CN=next{k} ", self.server.log_text())
        self.assertTrue(any(child.poll() is None for child in busy), "the certificates were replaced under load")
        for child in busy:
            out, err = child.communicate(timeout=120)
            self.assertEqual(child.returncode, 0, err)
            self.assertIn("designs", out)


if __name__ == "__main__":
    main()
