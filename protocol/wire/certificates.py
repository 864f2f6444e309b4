"""The certificate of this process, which it shows whoever dials it.

Nobody trusts it by itself: the handshake's proofs cover its fingerprint, and prove that both sides know the token.
"""

import datetime
import hashlib
import ssl
import tempfile
from functools import cache
from typing import Any

from volsplat.protocol.text.errors import BadInput

NAME = "volsplat"
DAYS = 3650  # nobody asks: it ends with the process


def fingerprint(certificate: bytes) -> bytes:
    """SHA-256 of a certificate in DER, as `openssl x509 -fingerprint -sha256` has it."""
    return hashlib.sha256(certificate).digest()


@cache
def accepting_context() -> tuple[ssl.SSLContext, bytes]:
    """What the side that is dialled speaks TLS with, and its certificate's fingerprint. Made once for the process.

    Raises BadInput where there is no folder for temporary files.
    """
    # Slow to import, and of no use where every link stays on this machine.
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    key = ec.generate_private_key(ec.SECP256R1())
    certificate = _self_signed(key)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.num_tickets = 0  # sessions are not resumed
    try:
        with tempfile.NamedTemporaryFile(prefix="volsplat-") as file:  # mode 0600; ssl takes nothing but a file's name
            file.write(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
            file.write(certificate.public_bytes(Encoding.PEM))
            file.flush()
            context.load_cert_chain(file.name)
    except OSError as error:
        raise BadInput(
            f"TLS needs a temporary file: {error.strerror or error}; set TMPDIR to a folder that can be written"
        ) from error
    return context, fingerprint(certificate.public_bytes(Encoding.DER))


@cache
def dialling_context() -> ssl.SSLContext:
    """What the side that dials speaks TLS with: it takes any certificate (see above)."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def _self_signed(key: Any) -> Any:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes

    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, NAME)])
    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=DAYS))
        .sign(key, hashes.SHA256())
    )
