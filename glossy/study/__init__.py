"""Speed against error of the real-time methods, and the paper's claims put to the test."""
