// What is left of a request is never taken for the next one.
#include "web/http_server.h"

#include <gtest/gtest.h>

#include <asio.hpp>
#include <optional>
#include <thread>

#include "base/error.h"

namespace cloudrenderer {
namespace {

class HttpServerTest : public testing::Test {
 protected:
  HttpServerTest() : http_(make_http_server({}, false, 4, "--test")) {
    using httplib::Request, httplib::Response;
    http_->Get("/", [](const Request&, Response& r) { r.set_content("page", "text/plain"); });
    http_->Get("/file", [](const Request&, Response& r) {
      r.set_content_provider(10, "text/plain", [](std::size_t offset, std::size_t, httplib::DataSink& sink) { return sink.write("0123456789" + offset, 1); });
    });
    http_->Get("/stream", [](const Request&, Response& r) {
      r.set_chunked_content_provider("text/plain", [](std::size_t offset, httplib::DataSink& sink) {
        if (offset == 6) sink.done();
        return offset == 6 || sink.write("abc", 3);
      });
    });
    http_->Post("/length", [](const Request& request, Response& r) { r.set_content(std::to_string(request.body.size()), "text/plain"); });
    http_->Post("/blind", [](const Request&, Response& r, const httplib::ContentReader&) {
      refuse(r, 403, "no");
      end_connection(r);
    });
    port_ = bind_http(*http_, {"127.0.0.1", 0}, "--test");
    thread_ = std::thread([this] { http_->listen_after_bind(); });
  }
  ~HttpServerTest() override {
    http_->stop();
    thread_.join();
  }

  // All that comes back for it. `ended`: the server has ended the connection, and not only waited for more.
  struct Answers {
    std::string text;
    bool ended = false;
    std::size_t count() const {
      std::size_t n = 0;
      for (std::size_t at = text.find("HTTP/1.1 "); at != std::string::npos; at = text.find("HTTP/1.1 ", at + 1)) ++n;
      return n;
    }
  };
  Answers ask(const std::string& request) const {
    asio::io_context context;
    asio::ip::tcp::socket socket(context);
    socket.connect({asio::ip::make_address("127.0.0.1"), static_cast<std::uint16_t>(port_)});
    asio::write(socket, asio::buffer(request));
    Answers answers;
    std::array<char, 4096> buffer;
    std::function<void()> read = [&] {
      socket.async_read_some(asio::buffer(buffer), [&](const asio::error_code& error, std::size_t n) {
        answers.text.append(buffer.data(), n);
        answers.ended = error && error != asio::error::operation_aborted;
        if (!error) read();
      });
    };
    read();
    context.run_for(std::chrono::milliseconds(300));
    socket.close();
    context.run();
    return answers;
  }

  std::unique_ptr<httplib::Server> http_;
  int port_ = 0;
  std::thread thread_;
};

TEST_F(HttpServerTest, GoesOnWithAConnectionThatIsReadToTheEnd) {
  for (const char* request : {"GET / HTTP/1.1\r\n\r\n", "GET / HTTP/1.1\r\nContent-Length: 0\r\n\r\n", "HEAD / HTTP/1.1\r\n\r\n",
                              "POST /length HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc", "GET /file HTTP/1.1\r\n\r\n", "GET /stream HTTP/1.1\r\n\r\n"}) {
    const Answers got = ask(request);
    EXPECT_EQ(got.count(), 1u) << request << got.text;
    EXPECT_FALSE(got.ended) << request;
    EXPECT_NE(got.text.find("200 OK"), std::string::npos) << got.text;
  }
}

TEST_F(HttpServerTest, AnswersOnceWhateverIsLeftOfARequest) {
  const std::string next = "GET / HTTP/1.1\r\n\r\n", line = "x\r\n\r\n";
  for (const std::string request :
       {"GET / HTTP/1.1\r\nContent-Length: 18\r\n\r\n", "HEAD / HTTP/1.1\r\nContent-Length: 18\r\n\r\n", "TRACE / HTTP/1.1\r\nContent-Length: 18\r\n\r\n",
        "OPTIONS / HTTP/1.1\r\nContent-Length: 18\r\n\r\n", "QUERY / HTTP/1.1\r\nHost: a\r\nContent-Length: 18\r\n\r\n",
        "GET /file HTTP/1.1\r\nContent-Length: 18\r\n\r\n", "GET /stream HTTP/1.1\r\nContent-Length: 18\r\n\r\n", "GET /none HTTP/1.1\r\nContent-Length: 18\r\n\r\n",
        "GET / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n12\r\n", "POST /blind HTTP/1.1\r\nContent-Length: 18\r\n\r\n",
        "POST /length HTTP/1.1\r\nContent-Length : 18\r\nContent-Length: 0\r\n\r\n", "POST /length HTTP/1.1\r\nContent-Length: 0\r\nContent-Length: 18\r\n\r\n",
        "POST /length HTTP/1.1\r\nContent-Length: 0,18\r\n\r\n", "POST /length HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n1\r\na,bad\r\n",
        "POST /length HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", "POST /length HTTP/1.1\r\nRange: bytes=x\r\nContent-Length: 18\r\n\r\n"}) {
    const Answers got = ask(request + next + line);
    EXPECT_EQ(got.count(), 1u) << request << got.text;
    EXPECT_TRUE(got.ended) << request;
    EXPECT_NE(got.text.find("Connection: close\r\n"), std::string::npos) << got.text;
    EXPECT_EQ(got.text.find("Keep-Alive"), std::string::npos) << got.text;
  }
}

TEST_F(HttpServerTest, GivesWholeAnswersBeforeItEndsTheConnection) {
  const std::string body = "\r\nContent-Length: 1\r\n\r\nx";
  EXPECT_TRUE(ask("GET / HTTP/1.1" + body).text.ends_with("\r\n\r\npage"));
  EXPECT_TRUE(ask("GET /file HTTP/1.1" + body).text.ends_with("\r\n\r\n0123456789"));
  EXPECT_TRUE(ask("GET /stream HTTP/1.1" + body).text.ends_with("3\r\nabc\r\n0\r\n\r\n"));
  EXPECT_TRUE(ask("HEAD / HTTP/1.1" + body).text.ends_with("\r\n\r\n"));
  EXPECT_TRUE(ask("GET / HTTP/1.1\r\nRange: bytes=1-2" + body).text.ends_with("\r\n\r\nag"));
}

}  // namespace
}  // namespace cloudrenderer
