"""The service's API under schemathesis: requests made from its OpenAPI page, good ones and broken ones. No 5xx, no hang,
nothing that the page does not know of, nothing without a token."""
import subprocess
import unittest

import service_test
import support
from support import measure

CHECKS = "not_a_server_error,status_code_conformance,content_type_conformance,response_schema_conformance,ignored_auth"


def program():
    """schemathesis in a virtual environment under build/; None when it cannot be had."""
    venv = measure.ROOT / "build" / "schemathesis-venv"
    if not (venv / "ready").exists():
        made = subprocess.run(["/usr/bin/python3", "-m", "venv", venv], capture_output=True).returncode == 0
        if not made or subprocess.run([venv / "bin" / "python", "-m", "pip", "install", "-q", "schemathesis==4.*"], capture_output=True).returncode != 0:
            return None
        (venv / "ready").touch()
    return venv / "bin" / "schemathesis"


class ApiFuzz(unittest.TestCase):
    def test_nothing_that_is_sent_breaks_the_service(self):
        schemathesis = program()
        if not schemathesis:
            self.skipTest("schemathesis cannot be installed: no network")
        service = service_test.Service("test_uploads_go_on_and_requests_are_checked")
        service.setUp()
        self.addCleanup(service.doCleanups)
        self.addCleanup(service.tearDown)
        service.serve(1)
        good = service.write("good.pbrt", 'Film "image" "integer xresolution" 16 "integer yresolution" 16 Camera "perspective" WorldBegin Shape "sphere" WorldEnd')
        service.command("ann", "submit", "--wait", good)  # so that job 1 is there to be asked for
        url = f"http://127.0.0.1:{service.api_port}"
        result = measure.run(["env", "-C", service.folder, schemathesis, "run", f"{url}/v1/openapi.json", "--url", url, "-H", "Authorization: Bearer ann's token", "--checks", CHECKS,
                              "--exclude-path", "/v1/watch", "--max-examples", "40", "--seed", "1", "--request-timeout", "20", "--phases", "examples,coverage,fuzzing", "--no-color"],
                             timeout=280)
        self.assertEqual(result.code, 0, result.output[-6000:])
        print("\n".join(result.output.splitlines()[-12:]))
        self.assertTrue(service.service.running(), service.service.text())
        service.command("ann", "submit", "--wait", good)  # whatever was removed or cancelled
        self.assertNotIn("[error]", service.service.text().lower())


if __name__ == "__main__":
    support.main()
