"""The links to the splat servers: what batches travel as, and how far they may be ahead."""
